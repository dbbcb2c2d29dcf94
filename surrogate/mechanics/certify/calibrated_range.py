r"""What a calibration of fast bounds was made on, and how other predictions are unlike it.

The held-out samples say nothing of loads and states unlike theirs. Nor does any bound hold where
the tangent K(u) is not positive definite: no stable equilibrium needs to be near. So a prediction
has no bound if

- its state is unstable, or as soft as few held-out ones: the smallest Ritz value θ of
  `surrogate.mechanics.certify.fast_estimate` is below that of all but the share `TAIL` of them, or
  below `LEAST_STIFFNESS`, since θ is an upper bound of the smallest eigenvalue;
- its estimated error over its largest displacement is beyond that of all but the share `TAIL`, by
  more than `MARGIN`;
- its largest displacement, a force component at a node or one of the resultant is beyond the
  largest of the held-out samples by more than `MARGIN`;
- a pressure is smaller or larger than theirs by more than `MARGIN` of their span, which holds 0;
- it has more or fewer loaded nodes than every held-out sample, or one at another place than those
  of the training.

Few loads like those of the calibration are refused: of n + 1 exchangeable samples, each has the
largest value of a quantity with probability 1 / (n + 1). Near an instability, and where predictions
are worst, the ratio of true and estimated error grows, and the last few samples do not tell it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.arguments import hold_read_only
from shared_schema.common.units import SI, Units

LEAST_STIFFNESS = 0.05
MARGIN = 0.05
TAIL = 0.02

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CalibratedRange:
    """Extremes of the held-out samples. Its arrays are read-only.

    Attributes
    ----------
    softest : float
        Ritz value that all but the share `TAIL` exceed, at least `LEAST_STIFFNESS`.
    displacement : float
        Largest displacement of a node in m.
    error : float
        Ratio of the estimated error to the displacement, each of the node where it is largest,
        that all but the share `TAIL` are below.
    force, resultant : array, (d,)
        Largest absolute components of a nodal force, and of the sum of a sample's forces, in N.
    fewest, most : int
        Numbers of loaded nodes of the samples that have a load.
    pressure : array, (2, n_surfaces)
        Smallest and largest pressure on each surface in Pa, 0 among them. All forces above are dead
        ones, without those of pressures.
    """

    softest: float
    displacement: float
    error: float
    force: Array
    resultant: Array
    fewest: int
    most: int
    pressure: Array = field(default_factory=lambda: np.zeros((2, 0)))

    def __post_init__(self) -> None:
        hold_read_only(self)

    @classmethod
    def of(
        cls,
        force: Array,
        predicted: Array,
        error: Array,
        softest: Array,
        pressure: Array | None = None,
    ) -> CalibratedRange:
        """Measure held-out samples, (n, n_nodes, d) in N, m and m, and (n,); n may be 0.

        Pressures are (n, n_surfaces) in Pa.
        """
        pressures = np.zeros((len(force), 0)) if pressure is None else pressure
        counts = loaded_nodes(force)
        counts = counts[counts > 0]
        return cls(
            softest=tail(softest[softest > LEAST_STIFFNESS], TAIL, np.inf),
            displacement=float(largest(predicted).max(initial=0.0)),
            error=tail(relative_size(error, predicted), 1 - TAIL, 0.0),
            force=np.abs(force).max(axis=(0, 1), initial=0.0),
            resultant=np.abs(force.sum(axis=1)).max(axis=0, initial=0.0),
            fewest=int(counts.min(initial=force.shape[1])),
            most=int(counts.max(initial=0)),
            pressure=np.stack([pressures.min(axis=0, initial=0), pressures.max(axis=0, initial=0)]),
        )

    def refusals(
        self,
        force: Array,
        predicted: Array,
        error: Array,
        softest: Array,
        loadable: NDArray[np.bool_],
        units: Units = SI,
        pressure: Array | None = None,
    ) -> tuple[str | None, ...]:
        """Say of each prediction why it has no bound; None if it has one.

        Parameters
        ----------
        force, predicted, error : array, (N, n_nodes, d)
            Dead forces in N, predicted displacements and their estimated errors in m.
        softest : array, (N,)
            Smallest Ritz values.
        loadable : array of bool, (n_nodes,)
            Nodes that the training loaded.
        units : Units
            Their labels, for the reasons.
        pressure : array, (N, n_surfaces), optional
            In Pa.
        """
        pressures = np.zeros((len(force), 0)) if pressure is None else pressure
        return tuple(
            next(self._reasons(f, u, e, float(s), loadable, units, p), None)
            for f, u, e, s, p in zip(force, predicted, error, softest, pressures, strict=True)
        )

    def _reasons(
        self,
        f: Array,
        u: Array,
        e: Array,
        softest: float,
        loadable: NDArray[np.bool_],
        units: Units,
        pressures: Array,
    ) -> Iterator[str]:
        """Yield the reasons against a single prediction, gravest first."""
        if softest == -np.inf or not np.isfinite(e).all():
            yield "inverted elements"
        if not softest > 0:
            yield "the predicted state is unstable, its stiffness is not positive definite"
        if not softest >= max(self.softest, LEAST_STIFFNESS):
            least = f"the calibration has {max(self.softest, LEAST_STIFFNESS):.2g} and more"
            yield f"near an instability: smallest stiffness {softest:.2g} of that at rest, {least}"
        unlike, beyond = "unlike the calibration of the bounds", 1 + MARGIN
        loaded = f.any(axis=1)
        count = int(loaded.sum())
        if count and not self.fewest <= count <= self.most:
            numbers = f"{self.fewest} to {self.most}" if self.fewest < self.most else self.most
            yield f"{unlike}: number of loaded nodes {count}, {numbers} there"
        if (loaded & ~loadable).any():
            yield f"{unlike}: a loaded node was never loaded in the training data"
        for name, values, limit in (
            ("force components at a node", np.abs(f).max(axis=0), self.force),
            ("resultant", np.abs(f.sum(axis=0)), self.resultant),
        ):
            if (values > beyond * limit).any():
                here, there = written(values), f"{written(limit)} {units.force}"
                yield f"{unlike}: {name} up to {here}, {there} there"
        low, high = self.pressure
        room = MARGIN * (high - low)
        if (
            pressures.shape != low.shape
            or ((pressures < low - room) | (pressures > high + room)).any()
        ):
            spans = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in zip(low, high, strict=True))
            given = ", ".join(f"{p:.4g}" for p in pressures)
            yield f"{unlike}: pressure {given} {units.stress}, {spans or 'none'} there"
        moved = float(largest(u[None])[0])
        if moved > beyond * self.displacement:
            most = units.written(self.displacement)
            yield f"{unlike}: displacement {units.written(moved)}, {most} there"
        share = float(relative_size(e[None], u[None])[0])
        if share > beyond * self.error:
            parts = f"{share:.2g} of the displacement, {self.error:.2g} there"
            yield f"{unlike}: estimated error {parts}"

    def arrays(self) -> dict[str, Array]:
        """Return the extremes by their names, as arrays."""
        arrays = {name: np.atleast_1d(np.float64(value)) for name, value in asdict(self).items()}
        return {name: value for name, value in arrays.items() if value.size}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array]) -> CalibratedRange:
        """Make one of what `arrays` returns; KeyError or ValueError if it is something else."""
        softest, displacement, error = (
            arrays[n].item() for n in ("softest", "displacement", "error")
        )
        fewest, most = int(arrays["fewest"].item()), int(arrays["most"].item())
        forces, pressure = (arrays["force"], arrays["resultant"]), arrays.get("pressure")
        pressure = np.zeros((2, 0)) if pressure is None else pressure.reshape(2, -1)
        return cls(softest, displacement, error, *forces, fewest, most, pressure)


def tail(values: Array, share: float, none: float) -> float:
    """Quantile of some values, towards their end; `none` if there are none."""
    towards: Literal["lower", "higher"] = "lower" if share < 0.5 else "higher"
    return float(np.quantile(values, share, method=towards)) if len(values) else none


def loaded_nodes(force: Array) -> NDArray[np.int64]:
    """Numbers of loaded nodes: (N, n_nodes, d) → (N,)."""
    return np.asarray(np.count_nonzero(force.any(axis=2), axis=1))


def largest(field: Array) -> Array:
    """Largest length at a node: (N, n_nodes, d) → (N,)."""
    return np.asarray(np.linalg.norm(field, axis=2).max(axis=1))


def relative_size(error: Array, displacement: Array) -> Array:
    """Ratios of the largest lengths at a node, (N,); 0 if both are 0, and +∞ if only the last."""
    size, whole = largest(error), largest(displacement)
    return np.divide(size, whole, out=np.where(size == 0, 0.0, np.inf), where=whole > 0)


def written(components: Array) -> str:
    """Write absolute components of a force, without their unit."""
    return f"±({', '.join(f'{value:.3g}' for value in components)})"
