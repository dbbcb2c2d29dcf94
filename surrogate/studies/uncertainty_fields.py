"""Error and uncertainty fields side by side (Figs. "2d_beam_error_uncertainty" and following)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from surrogate.calibration import half_width, rank_correlation
from surrogate.example import find_example
from surrogate.extrapolation import BAND
from surrogate.geometry import Geometry
from surrogate.metrics import node_errors
from surrogate.nodal_dataset import NodalSamples
from surrogate.prediction import Distribution
from surrogate.published import PUBLISHED
from surrogate.studies.accuracy import MM
from surrogate.studies.multiple_loads import LOADS, TIP_DISPLACEMENT
from surrogate.studies.record import Claim, Table
from surrogate.studies.study import Outcome, Study
from surrogate.studies.workshop import Workshop
from surrogate.uncertainty_figures import error_beside_uncertainty

Array = NDArray[np.float64]
RUN, SWEEP = "beam2d-vb", "beam2d_sweep"
BEYOND = 5.0  # N, upwards: twice the largest force in training
STRONG = 0.7  # a rank correlation from which fields count as strongly correlated
CLOSE = 2.0  # a factor within which error and standard deviation count as close


@dataclass(frozen=True)
class Example:
    """One load case: what it is, its force in N, and u, μ and σ in m, (n_nodes, d) each."""

    what: str
    force: Array
    reference: Array
    mean: Array
    std: Array


@dataclass(frozen=True)
class FieldMeasures:
    """Error and standard deviation over the free nodes.

    Attributes
    ----------
    error, std : float
        Mean nodal ‖U − u‖₂ and ‖σ‖₂, in m.
    rank_correlation, linear_correlation : float
        Spearman's and Pearson's, between the two over the nodes.
    covered : float
        Share of the components whose error is inside the 95 % band.
    """

    error: float
    std: float
    rank_correlation: float
    linear_correlation: float
    covered: float


def measure_fields(mean: Array, std: Array, reference: Array) -> FieldMeasures:
    """Measure fields of free nodes, (n_nodes, d) each in m."""
    error, spread = node_errors(mean, reference), np.linalg.norm(std, axis=1)
    return FieldMeasures(
        error=float(error.mean()),
        std=float(spread.mean()),
        rank_correlation=float(rank_correlation(error, spread)),
        linear_correlation=float(np.corrcoef(error, spread)[0, 1]),
        covered=float((np.abs(mean - reference) <= half_width(BAND) * std).mean()),
    )


def correlated(what: str, measures: FieldMeasures) -> Claim:
    """Whether error and uncertainty are strongly correlated in space."""
    return Claim(
        what=f"Error and uncertainty are strongly correlated in space: {what}.",
        holds=measures.rank_correlation >= STRONG,
        evidence=f"Rank correlation over the free nodes {measures.rank_correlation:.2f} (strong "
        f"from {STRONG} on), linear correlation {measures.linear_correlation:.2f}.",
    )


def close(what: str, measures: FieldMeasures) -> Claim:
    """Whether error and uncertainty are of the same size."""
    ratio = measures.error / measures.std
    return Claim(
        what=f"Outside the training range error and uncertainty are close to each other: {what}.",
        holds=1 / CLOSE <= ratio <= CLOSE,
        evidence=f"Mean error over mean standard deviation {ratio:.2f} (close within a factor of "
        f"{CLOSE:g}).",
    )


def conduct(workshop: Workshop) -> Outcome:
    """Compare error and uncertainty of three examples."""
    geometry = workshop.surrogate(RUN).geometry
    free = ~geometry.clamped
    shown = {"corner": corner(workshop), "multiple": multiple(workshop)}
    beyond = {"beyond": at_corner(workshop, BEYOND), "below": at_corner(workshop, -BEYOND)}
    examples = shown | beyond
    measured = {
        name: measure_fields(example.mean[free], example.std[free], example.reference[free])
        for name, example in examples.items()
    }
    return Outcome(
        tables=[fields_table({examples[name].what: measured[name] for name in examples})],
        claims=[
            *(correlated(examples[name].what, measured[name]) for name in (*shown, "beyond")),
            close(examples["beyond"].what, measured["beyond"]),
        ],
        figures={name: figure_of(geometry, examples[name]) for name in (*shown, "beyond")},
    )


def corner(workshop: Workshop) -> Example:
    """The test sample loaded at the corner, displaced there as far as the paper's."""
    tip = workshop.surrogate(RUN).geometry.tip
    test, predicted = workshop.dataset_of(RUN).nodal_test, workshop.predicted_test(RUN)
    aim = PUBLISHED["beam2d", "deterministic"].tip_displacement
    number = find_example(test.force, test.displacement, tip, np.array([tip]), aim)
    return example_of("test sample loaded at the corner", test, predicted, number)


def multiple(workshop: Workshop) -> Example:
    """The sample with several forces whose corner is displaced as far as the paper's."""
    geometry, loads = workshop.surrogate(RUN).geometry, workshop.predicted_loads(RUN, LOADS)
    force, displacement = loads.samples.force, loads.samples.displacement
    number = find_example(force, displacement, geometry.tip, geometry.loadable, TIP_DISPLACEMENT)
    return example_of("several forces", loads.samples, loads.predicted, number)


def at_corner(workshop: Workshop, newtons: float) -> Example:
    """The sample whose vertical force at the corner is nearest to one in N."""
    loads = workshop.predicted_loads(RUN, SWEEP)
    vertical = loads.samples.force[..., 1].sum(axis=1)
    number = int(np.abs(vertical - newtons).argmin())
    way = "upwards" if newtons > 0 else "downwards"
    what = f"{abs(vertical[number]):.3g} N {way} at the corner"
    return example_of(what, loads.samples, loads.predicted, number)


def example_of(what: str, samples: NodalSamples, predicted: Distribution, number: int) -> Example:
    """One of several samples."""
    return Example(
        what,
        samples.force[number],
        samples.displacement[number],
        predicted.mean[number],
        predicted.std[number],
    )


def fields_table(measured: dict[str, FieldMeasures]) -> Table:
    """Measures of every example."""
    return Table(
        caption="Norms of errors and standard deviations at the free nodes.",
        head=(
            "example",
            "mean error [mm]",
            "mean σ [mm]",
            "error / σ",
            "rank correlation",
            "linear correlation",
            "inside the 95 % band",
        ),
        rows=tuple(
            (
                what,
                MM * m.error,
                MM * m.std,
                m.error / m.std,
                m.rank_correlation,
                m.linear_correlation,
                m.covered,
            )
            for what, m in measured.items()
        ),
    )


def figure_of(geometry: Geometry, example: Example) -> tuple[Figure, str]:
    """Error and uncertainty fields of an example, and the caption."""
    drawn = error_beside_uncertainty(
        geometry, example.force, example.mean, example.std, example.reference
    )
    tip = np.linalg.norm(example.reference[geometry.tip])
    return drawn, (
        f"2D beam, {example.what}, tip displacement {tip:.2f} m: error (left, with the mesh of the "
        "finite elements) and one standard deviation (right) on the deformed mesh of the U-Net."
    )


STUDY = Study(
    name="uncertainty-fields",
    title="Error and uncertainty fields of the 2D beam",
    labels=(
        "fig: 2d_beam_error_uncertainty",
        "fig: 2d_multiplef_error_uncertainty",
        "fig: 2d_5Nf_error_uncertainty",
    ),
    question="Does the uncertainty say where the error is: for a load as in training, for several "
    "at once, and for one twice as large? (The paper does not say which way its 5 N act; here "
    "upwards, the other way in the table as well.)",
    conduct=conduct,
    datasets=(LOADS, SWEEP),
    runs=(RUN,),
)
