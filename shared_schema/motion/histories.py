r"""Loads over time: the factor :math:`s(t)` of a load f in the external force s(t) f.

===========  ==========================================================================
history      factor
===========  ==========================================================================
``held``     1 from t = 0 on; the body is at rest before
``let_go``   0; the body is in equilibrium under f at t = 0, and is let go
``ramp``     :math:`\min(1, t / T)`
``random``   :math:`\sum_k w_k \sin(2 π f_k t)` of 8 waves, with :math:`\sum_k |w_k| = 1`
===========  ==========================================================================

The waves of a sample are drawn by seed and sample number: frequencies f_k uniform up to the given
one, and weights w_k in proportion to numbers uniform in (−1, 1). So |s| ≤ 1 and s(0) = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shared_schema.common.configuration import Frozen
from shared_schema.common.errors import InputError

Array = NDArray[np.float64]
WAVES = 8
EXPECTED = "held, let_go, ramp=SECONDS or random=HERTZ"
Duration: TypeAlias = Annotated[float, Field(gt=0, le=1e12)]


class Ramp(Frozen):
    """A load that grows.

    Attributes
    ----------
    ramp : float
        Time in s after which the whole load acts.
    """

    ramp: Duration


class Waves(Frozen):
    """Band of frequencies.

    Attributes
    ----------
    frequency : float
        Largest frequency in Hz.
    """

    frequency: float = Field(gt=0, le=1e12)


class Band(Frozen):
    """A load that varies at random.

    Attributes
    ----------
    random : Waves
    """

    random: Waves


History: TypeAlias = Literal["held", "let_go"] | Ramp | Band


def read_history(text: str) -> History:
    """Read a history as a command has it: ``held``, ``let_go``, ``ramp=0.5`` or ``random=2``.

    Raises
    ------
    InputError
        If it is none.
    """
    name, _, value = text.partition("=")
    if not value and name in ("held", "let_go"):
        return "held" if name == "held" else "let_go"
    try:
        number = float(value)
        if name == "ramp":
            return Ramp(ramp=number)
        if name == "random":
            return Band(random=Waves(frequency=number))
    except ValueError:
        pass
    raise InputError(f"--history '{text}': expected {EXPECTED}")


def history_of(content: Any) -> History:
    """Build a history from plain data; ValueError with one line if it is none."""
    if content in ("held", "let_go") or isinstance(content, (Ramp, Band)):
        known: History = content
        return known
    if isinstance(content, dict) and set(content) == {"ramp"}:
        return Ramp.model_validate(content)
    if isinstance(content, dict) and set(content) == {"random"}:
        return Band.model_validate(content)
    raise ValueError("expected held, let_go, {ramp: seconds} or {random: {frequency: Hz}}")


@dataclass(frozen=True)
class LoadOverTime:
    """The factor of one sample's load.

    Attributes
    ----------
    history : History
    frequencies, weights : array, (8,)
        f_k in Hz and w_k of a random history; empty of others.
    """

    history: History
    frequencies: Array
    weights: Array

    @classmethod
    def of(cls, history: History, seed: int = 0, number: int = 0) -> LoadOverTime:
        """Draw the waves of a sample, if it has any."""
        if not isinstance(history, Band):
            return cls(history, np.empty(0), np.empty(0))
        rng = np.random.default_rng((seed, number, WAVES))
        frequencies = history.random.frequency * rng.uniform(size=WAVES)
        weights = rng.uniform(-1, 1, size=WAVES)
        return cls(history, frequencies, weights / np.abs(weights).sum())

    @property
    def begins_loaded(self) -> bool:
        """True if the body is in equilibrium under the whole load before t = 0."""
        return self.history == "let_go"

    def factor(self, time: float) -> float:
        """Return s at a time t ≥ 0 in s."""
        if self.history == "held":
            return 1.0
        if self.history == "let_go":
            return 0.0
        if isinstance(self.history, Ramp):
            return min(1.0, time / self.history.ramp)
        return float(self.weights @ np.sin(2 * np.pi * self.frequencies * time))
