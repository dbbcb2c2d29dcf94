r"""Proper orthogonal decomposition of displacements, with regression of the coefficients.

.. math:: u(f) ≈ \bar u + \sum_{k=1}^{r} c_k(f) \, φ_k

The orthonormal modes φ are the leading principal components of the training displacements
(snapshots). The coefficients c come from ridge regression or from a Gaussian process (Guo and
Hesthaven 2018). A Gaussian process also gives standard deviations of the coefficients. With the
truncation error of the modes, they give the standard deviations at the nodes:

.. math:: σ_i^2 = \sum_k φ_{ki}^2 \, σ_k(f)^2 + \frac{1}{N} \sum_n (u_{ni} - \tilde u_{ni})^2

With `inputs: linear_modes`, the process is given coefficients :math:`a_k` of the leading modes of
the linear response K⁻¹f instead of forces, as reduced networks are
(`surrogate.learning.networks.reduced_network`). It then predicts what the linear response leaves
over. Each coefficient is divided by the square root of its root mean square. Under loads drawn
alike at all places :math:`a_k` grows with the compliance of its mode, so that the squared distance
of two loads f and f' is about :math:`(f - f')^T K^{-1} (f - f')`, an elastic energy.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from math import comb
from typing import ClassVar, Literal, Self

import torch
from pydantic import Field, model_validator
from torch import Tensor
from torch.nn import functional

from shared_schema.common.configuration import Frozen
from surrogate.contrib.regressions import Fitted, GaussianProcess, RidgeRegression
from surrogate.learning.networks.field_network import SMALLEST_STD, FieldNetwork, at_points, on_grid
from surrogate.learning.networks.modes import modal_encoder
from surrogate.learning.probabilistic.likelihoods import (
    Prediction,
    deterministic_loss,
    negative_log_likelihood,
)

ENERGY = 1 - 1e-8
INPUT_MODES = 48


class PODConfig(Frozen, ABC):
    """Number of modes, and the regression of their coefficients.

    Attributes
    ----------
    regression : {"ridge", "gp"}
        Ridge regression or a Gaussian process.
    energy : float
        Fraction of the variance of the training displacements that the modes capture.
    rank : int, optional
        Number of modes r, instead of `energy`. It suits large bodies, because it needs no complete
        singular value decomposition.
    """

    objective: ClassVar[str]

    regression: str
    energy: float = Field(ENERGY, gt=0, lt=1)
    rank: int | None = Field(None, ge=1, le=10**5)

    @property
    def linear_modes(self) -> int:
        """Number of modes of the linear response that the regression is given instead of forces."""
        return 0

    @model_validator(mode="after")
    def _energy_or_rank(self) -> Self:
        if self.rank is not None and self.energy != ENERGY:
            raise ValueError(f"energy = {self.energy}: expected none beside rank = {self.rank}")
        return self

    @abstractmethod
    def make_regression(self) -> RidgeRegression | GaussianProcess:
        """Make the regression, not yet fitted."""

    @abstractmethod
    def data_loss(self, prediction: Prediction, reference: Tensor, network: FieldNetwork) -> Tensor:
        """Return the loss per datum (see `surrogate.learning.models.model.Model.data_loss`)."""

    @property
    @abstractmethod
    def summary(self) -> str:
        """Describe the fit."""

    @abstractmethod
    def memory(self, samples: int, dimension: int, loadable: int) -> int:
        """Estimate the memory in bytes that the fit of the regression takes.

        Parameters
        ----------
        samples : int
            Number of training samples.
        dimension : int
            Number of space dimensions d.
        loadable : int
            Number of nodes that may be loaded.
        """


class RidgeConfig(PODConfig):
    """Ridge regression of the coefficients.

    Attributes
    ----------
    degree : int
        Degree of the polynomials of the forces.
    penalty : float
        Penalty on the squared weights.
    """

    objective = "mean squared error"

    regression: Literal["ridge"] = "ridge"
    degree: int = Field(6, ge=1, le=20)
    penalty: float = Field(1e-8, ge=1e-30, le=1e6)

    def make_regression(self) -> RidgeRegression:
        """Make the regression, not yet fitted."""
        return RidgeRegression(self.degree, self.penalty)

    def data_loss(self, prediction: Prediction, reference: Tensor, network: FieldNetwork) -> Tensor:
        """Return the mean squared error per datum, which ridge regression minimises."""
        return deterministic_loss("mse", prediction.mean, reference, network.displacement_rms)

    @property
    def summary(self) -> str:
        """Describe the fit."""
        return f"ridge regression, degree {self.degree}"

    def memory(self, samples: int, dimension: int, loadable: int) -> int:
        """Monomials of all samples (`monomials`), in double precision."""
        return 8 * samples * loadable * (comb(dimension + self.degree, dimension) - 1)


class GaussianProcessConfig(PODConfig):
    """Gaussian process regression of the coefficients.

    Attributes
    ----------
    gp_samples : int
        Largest number of training samples in the process.
    tuned_modes : int, optional
        Number of leading modes whose coefficients the kernel's parameters are fitted to. All modes
        by default, each with the same weight, however little it adds to the displacement.
    inputs : {"force", "linear_modes"}
        Inputs of the process: the forces at the nodes that are loaded in training, or coefficients
        of modes of the linear response. With the latter, it predicts the difference from that.
    input_modes : int, optional
        Number of these modes; 48 by default.
    """

    objective = "negative log-likelihood"

    regression: Literal["gp"]
    gp_samples: int = Field(2000, ge=2, le=50_000)
    tuned_modes: int | None = Field(None, ge=1, le=10**5)
    inputs: Literal["force", "linear_modes"] = "force"
    input_modes: int | None = Field(None, ge=1, le=10**4)

    @model_validator(mode="after")
    def _modes_of_the_linear_response(self) -> Self:
        if self.input_modes is not None and self.inputs == "force":
            raise ValueError(
                f"input_modes = {self.input_modes}: expected with inputs 'linear_modes' only"
            )
        return self

    @property
    def linear_modes(self) -> int:
        """Number of modes of the linear response, 0 without it."""
        return (self.input_modes or INPUT_MODES) if self.inputs == "linear_modes" else 0

    def make_regression(self) -> GaussianProcess:
        """Make the regression, not yet fitted."""
        return GaussianProcess(self.gp_samples, self.tuned_modes)

    def data_loss(self, prediction: Prediction, reference: Tensor, network: FieldNetwork) -> Tensor:
        """Return the negative log-likelihood per datum in nats."""
        unit = network.displacement_rms
        return negative_log_likelihood(prediction, reference, network.free_components, unit)

    @property
    def summary(self) -> str:
        """Describe the fit."""
        return f"Gaussian process, {self.gp_samples} samples at most"

    def memory(self, samples: int, dimension: int, loadable: int) -> int:
        """Kernel matrix, its Cholesky factor and its three derivatives, in double precision."""
        return 8 * 5 * min(self.gp_samples, samples) ** 2


class PODNetwork(Fitted):
    """Map from scaled force grid to scaled displacement grid, computed in double precision.

    Parameters
    ----------
    config : PODConfig
    free : Tensor of bool, (nx, ny[, nz])
        True at grid points that are nodes and not clamped.

    Attributes
    ----------
    loaded : Tensor of int, (n_loaded,)
        Numbers of the points, in the flattened grid, that carry a force in training.
    mean : Tensor, (d · n_free,)
        Mean displacement of the training samples.
    modes : Tensor, (r, d · n_free)
        Orthonormal modes.
    truncation : Tensor, (d · n_free,)
        Root mean square of the truncation error of the training displacements.
    encoder : Tensor, (linear_modes, d · n_free)
        Scaled forces to scaled coefficients of the linear response; with `linear_modes` only.
    """

    free: Tensor
    loaded: Tensor
    mean: Tensor
    modes: Tensor
    truncation: Tensor
    encoder: Tensor

    def __init__(self, config: PODConfig, free: Tensor) -> None:
        encoder = ("encoder",) if config.linear_modes else ()
        super().__init__("loaded", "mean", "modes", "truncation", *encoder)
        self.config = config
        self.register_buffer("free", free.flatten().nonzero().squeeze(1), persistent=False)
        self.regression = config.make_regression()

    @torch.no_grad()
    def fit_encoder(
        self,
        respond: Callable[[Tensor], Tensor],
        linear: Tensor,
        force_scale: Tensor,
        seed: int,
    ) -> None:
        """Compute the modes of the linear response, before `fit` (see `modal_encoder`)."""
        count = self.config.linear_modes
        self.encoder = modal_encoder(respond, linear, self.free, count, force_scale, seed).double()

    def fit(self, force: Tensor, displacement: Tensor, seed: int) -> None:
        """Fit modes and regression to scaled fields on the CPU, both (N, d, nx, ny[, nz])."""
        from sklearn.decomposition import PCA

        snapshots = at_points(displacement, self.free).double().numpy()
        components = self.config.rank or self.config.energy
        solver = "auto" if self.config.rank else "full"
        pca = PCA(components, svd_solver=solver, random_state=seed % 2**32).fit(snapshots)
        coefficients = pca.transform(snapshots)
        rest = torch.from_numpy(snapshots - pca.inverse_transform(coefficients))
        self.mean, self.modes = torch.from_numpy(pca.mean_), torch.from_numpy(pca.components_)
        self.truncation = rest.square().mean(dim=0).sqrt()
        self.loaded = force.flatten(2).any(dim=0).any(dim=0).nonzero().squeeze(1)
        generator = torch.Generator().manual_seed(seed)
        self.regression.fit(self._inputs(force), torch.from_numpy(coefficients), generator)

    def forward(self, force: Tensor) -> Prediction:
        """Predict scaled displacements (N, d, nx, ny[, nz]) from scaled forces."""
        coefficients, std = self.regression(self._inputs(force))
        mean = self._on_grid(self.mean + coefficients @ self.modes, force)
        if std is None:
            return Prediction(mean, None)
        variance = std.square() @ self.modes.square() + self.truncation.square()
        return Prediction(mean, self._on_grid(variance.sqrt() + SMALLEST_STD, force))

    def _inputs(self, force: Tensor) -> Tensor:
        """Return the forces at the points that are loaded in training, (N, d, n_loaded).

        With `linear_modes`, return the coefficients of the linear response, (N, linear_modes).
        """
        if self.config.linear_modes:
            return functional.linear(at_points(force, self.free).double(), self.encoder)
        return force.flatten(2).index_select(2, self.loaded).double()

    def _on_grid(self, values: Tensor, like: Tensor) -> Tensor:
        """Place the values of free degrees of freedom on the grid, in the precision of another."""
        return on_grid(values.to(like), self.free, like)
