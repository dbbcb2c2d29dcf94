"""Single loads that are shown: a sweep of forces at one node, and an example of the test split."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surrogate.learning.measures.extrapolation import BAND, Extrapolation
from surrogate.learning.probabilistic.calibration import half_width, rank_correlation

Array = NDArray[np.float64]
SHARE = 0.75  # default aim, as a share of the largest tip displacement


@dataclass(frozen=True)
class ForceSweep:
    """Displacement of the loaded node in the direction of the force, forces ascending.

    Attributes
    ----------
    axis : int
        Direction of the force.
    limit : float
        Largest force component in training, in N.
    force : array, (N,)
        Force components in N.
    reference, mean, std_epistemic, std_aleatoric : array, (N,)
        Displacement, its predicted mean and standard deviations, in m.
    node_error, moved : array, (N,)
        Norms ‖U − u‖₂ and ‖u‖₂ over all components at the loaded node, in m.
    covered_across : array of bool, (N,)
        Forces for which the errors across the force are inside the 95 % band.
    covered_components : array, (N,)
        Share of all free components whose error is inside the 95 % band.
    """

    axis: int
    limit: float
    force: Array
    reference: Array
    mean: Array
    std_epistemic: Array
    std_aleatoric: Array
    node_error: Array
    moved: Array
    covered_across: NDArray[np.bool_]
    covered_components: Array

    @property
    def std(self) -> Array:
        """Total standard deviation in m, (N,)."""
        return np.hypot(self.std_epistemic, self.std_aleatoric)

    @property
    def error(self) -> Array:
        """Difference of predicted mean and reference in m, (N,)."""
        return self.mean - self.reference

    @property
    def outside(self) -> NDArray[np.bool_]:
        """Mask of the forces beyond those of the training, (N,)."""
        return np.abs(self.force) > self.limit

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Mask of the forces for which the error is inside the 95 % band, (N,)."""
        return np.abs(self.error) <= half_width(BAND) * self.std

    @property
    def senses(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Masks of the negative and the positive forces beyond those of the training, (N,) each."""
        return self.outside & (self.force < 0), self.outside & (self.force > 0)

    @property
    def growth(self) -> float:
        """Rank correlation of σ and |force| beyond the training, the smaller of both senses."""
        return min(
            float(rank_correlation(np.abs(self.force[sense]), self.std[sense]))
            for sense in self.senses
        )

    def nearest(self, force: float) -> int:
        """Number of the force that is nearest to `force`."""
        return int(np.abs(self.force - force).argmin())

    def at(self, force: float, values: Array) -> float:
        """Mean of values (N,) at the forces nearest to ±`force`."""
        return float(values[[self.nearest(-force), self.nearest(force)]].mean())


def force_sweep(extrapolation: Extrapolation) -> ForceSweep:
    """Extract the sweep from predictions of samples that all load one node.

    The largest force in training is rounded to three digits, because random forces do not reach the
    very end of their range.
    """
    node, force = extrapolation.node, extrapolation.samples.force
    assert node is not None
    axis = int(np.abs(force[:, node]).max(axis=0).argmax())
    order = np.argsort(force[:, node, axis])
    predicted = extrapolation.predicted
    limit = extrapolation.surrogate.description.data.info.force.max_abs[axis]

    def here(values: Array) -> Array:
        return values[order, node, axis]

    reference = extrapolation.samples.displacement[order, node]
    error = predicted.mean[order, node] - reference
    covered = np.abs(error) <= half_width(BAND) * predicted.std[order, node]
    return ForceSweep(
        axis=axis,
        limit=float(f"{limit:.3g}"),
        force=here(force),
        reference=here(extrapolation.samples.displacement),
        mean=here(predicted.mean),
        std_epistemic=here(predicted.std_epistemic),
        std_aleatoric=here(predicted.std_aleatoric),
        node_error=np.linalg.norm(error, axis=1),
        moved=np.linalg.norm(reference, axis=1),
        covered_across=np.delete(covered, axis, axis=1).all(axis=1),
        covered_components=extrapolation.inside[order],
    )


def find_example(
    force: Array,
    displacement: Array,
    tip: int,
    nodes: NDArray[np.int64] | NDArray[np.bool_],
    aim: float | None = None,
) -> int:
    """Find the sample with the tip displacement nearest to an aim.

    Parameters
    ----------
    force, displacement : array, (M, n_nodes, d)
        Nodal forces in N and displacements in m.
    tip : int
        Node of the tip.
    nodes : array of int or of bool, (n_nodes,)
        Candidates are samples that load one of these nodes; all samples if there is none.
    aim : float, optional
        Tip displacement in m; by default `SHARE` of the largest among the candidates.
    """
    moved = np.linalg.norm(displacement[:, tip], axis=1)
    candidates = np.flatnonzero(force[:, nodes].any(axis=(1, 2)))
    if candidates.size == 0:
        candidates = np.arange(len(moved))
    if aim is None:
        aim = SHARE * float(moved[candidates].max())
    return int(candidates[np.abs(moved[candidates] - aim).argmin()])


def tip_measures(predicted: Array, reference: Array, tip: int) -> tuple[float, float]:
    """Tip displacement ‖u‖ in m of one sample (n_nodes, d), and ‖U − u‖ / ‖u‖ at the tip."""
    moved = float(np.linalg.norm(reference[tip]))
    error = float(np.linalg.norm(predicted[tip] - reference[tip]))
    return moved, error / moved if moved else 0.0
