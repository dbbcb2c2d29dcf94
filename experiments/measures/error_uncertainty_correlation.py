"""Agreement of the fields of error and predicted uncertainty over the nodes of a body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.framework.record import Claim, Table
from experiments.measures.errors_on_test_split import MM
from surrogate.measures import BAND, node_errors
from surrogate.probabilistic import half_width, rank_correlation

Array = NDArray[np.float64]
STRONG = 0.7  # rank correlation from which fields count as strongly correlated
CLOSE = 2.0  # factor within which error and standard deviation count as close


@dataclass(frozen=True)
class FieldMeasures:
    """Measures of error and standard deviation over the free nodes.

    Attributes
    ----------
    error, std : float
        Mean nodal ‖U − u‖₂ and ‖σ‖₂, in m.
    rank_correlation, linear_correlation : float
        Spearman's and Pearson's correlation of the two over the nodes.
    with_displacement : float
        Spearman's correlation of the error and the displacement ‖u‖₂. This is the baseline: on a
        cantilever everything grows towards the tip.
    covered : float
        Share of the components whose error is inside the 95 % band.
    """

    error: float
    std: float
    rank_correlation: float
    linear_correlation: float
    with_displacement: float
    covered: float


def measure_fields(mean: Array, std: Array, reference: Array) -> FieldMeasures:
    """Measure fields of free nodes, (n_nodes, d) each in m."""
    error = node_errors(mean, reference)
    deviation, moved = (np.linalg.norm(values, axis=1) for values in (std, reference))
    return FieldMeasures(
        error=float(error.mean()),
        std=float(deviation.mean()),
        rank_correlation=float(rank_correlation(error, deviation)),
        linear_correlation=float(np.corrcoef(error, deviation)[0, 1]),
        with_displacement=float(rank_correlation(error, moved)),
        covered=float((np.abs(mean - reference) <= half_width(BAND) * std).mean()),
    )


def correlated(what: str, measures: FieldMeasures) -> Claim:
    """Test whether error and uncertainty are strongly correlated in space."""
    return Claim(
        what=f"Error and uncertainty are strongly correlated in space: {what}.",
        holds=measures.rank_correlation >= STRONG,
        evidence=f"Rank correlation over the free nodes {measures.rank_correlation:.2f} (strong "
        f"from {STRONG} on), linear correlation {measures.linear_correlation:.2f}; of the error "
        f"with the displacement alone, rank correlation {measures.with_displacement:.2f}.",
    )


def close(statement: str, measures: FieldMeasures) -> Claim:
    """Test the statement that error and uncertainty are of the same size."""
    ratio = measures.error / measures.std
    return Claim(
        what=statement,
        holds=1 / CLOSE <= ratio <= CLOSE,
        evidence=f"Mean error over mean standard deviation {ratio:.3g} (close within a factor of "
        f"{CLOSE:g}); {100 * measures.covered:.3g} % of the components inside the 95 % band.",
    )


def fields_table(measured: dict[str, FieldMeasures]) -> Table:
    """Table of the measures of every example."""
    return Table(
        caption="Norms of errors and standard deviations at the free nodes, and how they correlate "
        "over these; as a baseline, how the error correlates with the displacement.",
        head=(
            "example",
            "mean error [mm]",
            "mean σ [mm]",
            "error / σ",
            "rank correlation of error and σ",
            "linear correlation of error and σ",
            "rank correlation of error and displacement",
            "inside the 95 % band [%]",
        ),
        rows=tuple(
            (
                what,
                MM * m.error,
                MM * m.std,
                m.error / m.std,
                m.rank_correlation,
                m.linear_correlation,
                m.with_displacement,
                100 * m.covered,
            )
            for what, m in measured.items()
        ),
    )
