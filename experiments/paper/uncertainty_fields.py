"""Error and uncertainty fields side by side (Figs. "2d_beam_error_uncertainty" and following)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Claim, Table
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import MM
from experiments.measures.vertical_force import describe_vertical_force
from experiments.paper.multiple_loads import LOADS, find_papers_example
from experiments.paper.published_numbers import PAPER
from surrogate.figures import error_beside_uncertainty
from surrogate.learning.data import Geometry, NodalSamples
from surrogate.learning.measures import BAND, find_example, node_errors
from surrogate.learning.probabilistic import Distribution, half_width, rank_correlation

Array = NDArray[np.float64]
STRONG = 0.7  # rank correlation from which fields count as strongly correlated
CLOSE = 2.0  # factor within which error and standard deviation count as close
RUN, SWEEP = "beam2d-vb", "beam2d_sweep"
BEYOND = PAPER.force_beyond_training_newton  # upwards; twice the largest force in training


@dataclass(frozen=True)
class Example:
    """One load case: name, force in N, and u, μ and σ in m, (n_nodes, d) each."""

    what: str
    force: Array
    reference: Array
    mean: Array
    std: Array


def measure(resources: Resources) -> Findings:
    """Compare error and uncertainty of three examples."""
    geometry = resources.surrogate(RUN).geometry
    free = ~geometry.clamped
    beyond = at_corner(resources, BEYOND)
    opposite = at_corner(resources, -BEYOND)
    shown = {"corner": corner(resources), "multiple": multiple(resources), "beyond": beyond}
    measured = {
        example.what: measure_fields(example.mean[free], example.std[free], example.reference[free])
        for example in (*shown.values(), opposite)
    }
    return Findings(
        tables=[fields_table(measured)],
        claims=[
            *(correlated(example.what, measured[example.what]) for example in shown.values()),
            close(
                "Within the training range the uncertainty gives an idea of the error: "
                f"{shown['corner'].what}.",
                measured[shown["corner"].what],
            ),
            close(
                "Under several forces error and uncertainty closely follow each other.",
                measured[shown["multiple"].what],
            ),
            close(
                f"Outside the training range error and uncertainty are close: {beyond.what}.",
                measured[beyond.what],
            ),
        ],
        figures={
            name: figure_of(geometry, example, measured[example.what])
            for name, example in shown.items()
        },
    )


def corner(resources: Resources) -> Example:
    """Test sample with the load and the displacement at the corner nearest to the paper's."""
    tip = resources.surrogate(RUN).geometry.tip
    test, predicted = resources.dataset_of(RUN).nodal_test, resources.predicted_test(RUN)
    aim = PAPER.networks["beam2d"]["deterministic"].examples["corner"].tip_displacement_m
    number = find_example(test.force, test.displacement, tip, np.array([tip]), aim)
    return example_of("test sample loaded at the corner", test, predicted, number)


def multiple(resources: Resources) -> Example:
    """Sample under several forces with the displacement of the corner nearest to the paper's."""
    geometry, loads = resources.surrogate(RUN).geometry, resources.predicted_loads(RUN, LOADS)
    number = find_papers_example(loads.samples, geometry)
    return example_of("several forces", loads.samples, loads.predicted, number)


def at_corner(resources: Resources, newtons: float) -> Example:
    """Sample of the sweep with the vertical force at the corner nearest to `newtons`."""
    loads = resources.predicted_loads(RUN, SWEEP)
    vertical = loads.samples.force[..., 1].sum(axis=1)
    number = int(np.abs(vertical - newtons).argmin())
    what = f"{describe_vertical_force(loads.samples.force[number])} at the corner"
    return example_of(what, loads.samples, loads.predicted, number)


def example_of(what: str, samples: NodalSamples, predicted: Distribution, number: int) -> Example:
    """Sample `number` and its prediction as an example."""
    return Example(
        what,
        samples.force[number],
        samples.displacement[number],
        predicted.mean[number],
        predicted.std[number],
    )


def figure_of(geometry: Geometry, example: Example, measures: FieldMeasures) -> tuple[Figure, str]:
    """Figure of the error and uncertainty fields of an example, and its caption."""
    drawn = error_beside_uncertainty(
        geometry, example.force, example.mean, example.std, example.reference
    )
    tip = np.linalg.norm(example.reference[geometry.tip])
    return drawn, (
        f"2D beam, {example.what}, tip displacement {tip:.2f} m: error (left) and one standard "
        "deviation (right) on the deformed mesh of the U-Net, each in its own colour scale: the "
        f"mean error is {measures.error / measures.std:.2g} times the mean σ."
    )


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
    deviation = np.linalg.norm(std, axis=1)
    moved = np.linalg.norm(reference, axis=1)
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


STUDY = Experiment(
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
    measure=measure,
    datasets=(LOADS, SWEEP),
    runs=(RUN,),
)
