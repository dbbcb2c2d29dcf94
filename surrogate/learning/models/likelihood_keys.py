"""Configuration keys that a likelihood adds to those of an architecture."""

from __future__ import annotations

from typing import Generic, Literal, TypeVar

from shared_schema.common.configuration import Frozen
from surrogate.learning.models.training_config import (
    DeterministicTraining,
    LikelihoodTraining,
    RegressionTraining,
)
from surrogate.learning.probabilistic.flipout import VariationalConfig

RandomWeights = TypeVar("RandomWeights", bound=VariationalConfig)


class Deterministic(Frozen):
    """Networks that predict displacements; ensembles and dropout add standard deviations."""

    likelihood: Literal["deterministic"] = "deterministic"
    training: DeterministicTraining = DeterministicTraining()


class MaximumLikelihood(Frozen):
    """Networks that predict a mean and a standard deviation of every component."""

    likelihood: Literal["maximum_likelihood"] = "maximum_likelihood"
    training: LikelihoodTraining = LikelihoodTraining()


class VariationalBayes(Frozen, Generic[RandomWeights]):
    """Networks with random weights, trained by variational Bayes.

    Attributes
    ----------
    variational : VariationalConfig
        Random weights and their priors.
    """

    likelihood: Literal["variational_bayes"] = "variational_bayes"
    variational: RandomWeights
    training: LikelihoodTraining = LikelihoodTraining()

    @property
    def posterior(self) -> RandomWeights:
        """Configuration of the random weights."""
        return self.variational


class Regression(Frozen):
    """One dense layer that predicts displacements."""

    likelihood: Literal["deterministic"] = "deterministic"
    training: RegressionTraining = RegressionTraining()


class Untrained(Frozen):
    """A model that follows from the body, and predicts displacements."""

    likelihood: Literal["deterministic"] = "deterministic"
