"""What directions aim at: a tolerance on the error, a time budget, or both."""

from __future__ import annotations

import math
from dataclasses import dataclass

from shared_schema.common.arguments import require_type
from shared_schema.common.errors import InputError


class UnreachedToleranceWarning(UserWarning):
    """Directions ended before the estimated error of a prediction was within the tolerance."""


@dataclass(frozen=True)
class Aim:
    """When directions stop.

    Attributes
    ----------
    tolerance : float or None
        Largest error of a node, relative to the largest displacement, or in m.
    budget : float or None
        Seconds for the directions of a load.
    in_metres : bool
        Whether the tolerance is in m.

    Raises
    ------
    InputError
        If a number is not positive and finite, or there is none.
    """

    tolerance: float | None = None
    budget: float | None = None
    in_metres: bool = False

    def __post_init__(self) -> None:
        require_positive("tolerance", self.tolerance)
        require_positive("budget", self.budget)
        if self.tolerance is None and self.budget is None:
            raise InputError("directions: expected a tolerance or a budget")

    def allowed(self, displacement: float) -> float:
        """Error in m that is allowed, 0 without a tolerance, by the largest displacement in m."""
        return (self.tolerance or 0.0) * (1.0 if self.in_metres else displacement)

    def has_time(self, seconds: float) -> bool:
        """Whether the budget is not spent after some seconds."""
        return self.budget is None or seconds < self.budget


def require_positive(name: str, value: float | None) -> None:
    """Raise InputError unless a number is positive and finite, or None."""
    require_type(name, value, float | None)
    if value is not None and not 0 < value < math.inf:
        raise InputError(f"{name} {value}: expected a positive number", name)
