"""Settings of the motion of a case (`time` in a case)."""

from __future__ import annotations

import math
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from shared_schema.common.configuration import Frozen
from shared_schema.motion.histories import Duration, History, LoadOverTime, history_of
from shared_schema.motion.scheme import Scheme

MOST_STEPS = 10_000_000
WHOLE = 1e-9  # of a step, that a duration may be longer than whole steps


class Damping(Frozen):
    """Damping of a body.

    Attributes
    ----------
    mass : float
        c in 1/s of the forces c M v.
    stiffness : float
        b in s of the stresses 2 μ b Ė, with the shear modulus μ at rest; a small vibration of the
        frequency ω in which no volume changes has the damping ratio b ω / 2.
    """

    mass: float = Field(0.0, ge=0, le=1e12)
    stiffness: float = Field(0.0, ge=0, le=1e12)


class TimeSettings(Frozen):
    """Time steps of the motion of a body.

    Attributes
    ----------
    step : float
        Time step h in s.
    duration : float
        Time T in s to the last frame; the last step ends there or beyond.
    scheme : {"generalised-alpha", "energy-momentum"}
        Scheme of the steps.
    dissipation : float
        ρ∞ of generalised-α: what a step leaves of a vibration that is too fast for it, from 0 to 1.
    damping : Damping
    mass : {"consistent", "lumped"}
        Mass matrix of the elements, or a diagonal one.
    load : History
        Factor of the load over time: held, let_go, {ramp: seconds} or {random: {frequency: Hz}}.
    every : int
        Every so many steps make a frame of a dataset.
    """

    step: Duration
    duration: Duration
    scheme: Literal["generalised-alpha", "energy-momentum"] = "generalised-alpha"
    dissipation: float = Field(0.8, ge=0, le=1)
    damping: Damping = Damping()
    mass: Literal["consistent", "lumped"] = "consistent"
    load: History = "held"
    every: int = Field(1, ge=1, le=MOST_STEPS)

    @field_validator("load", mode="before")
    @classmethod
    def _is_a_history(cls, value: Any) -> History:
        return history_of(value)

    @model_validator(mode="after")
    def _has_some_steps(self) -> TimeSettings:
        if self.duration < self.step:
            raise ValueError(
                f"duration = {self.duration:g} s: expected at least one step = {self.step:g} s"
            )
        if self.steps > MOST_STEPS:
            raise ValueError(
                f"duration = {self.duration:g} s has {self.steps} steps of {self.step:g} s, "
                f"expected at most {MOST_STEPS}"
            )
        return self

    @property
    def steps(self) -> int:
        """Number of steps."""
        return math.ceil(self.duration / self.step - WHOLE)

    @property
    def frames(self) -> tuple[int, ...]:
        """Numbers of the steps after which there is a frame, from 0, the begin, to the last."""
        return (*range(0, self.steps, self.every), self.steps)

    @property
    def rule(self) -> Scheme:
        """Coefficients of the scheme."""
        if self.scheme == "energy-momentum":
            return Scheme.energy_momentum(self.step, self.damping.mass)
        return Scheme.generalised_alpha(self.step, self.dissipation, self.damping.mass)

    def load_over_time(self, seed: int = 0, number: int = 0) -> LoadOverTime:
        """Factor of the load of a sample."""
        return LoadOverTime.of(self.load, seed, number)
