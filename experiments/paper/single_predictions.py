"""Test samples by deterministic U-Nets (Figures "2d_beam_test", "2d_L_test", "3d_test")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Claim, Table, compare
from experiments.framework.resources import Resources
from experiments.measures.error_displacement_correlation import (
    error_correlation,
    split_correlations,
)
from experiments.measures.errors_on_test_split import BODIES, MM
from experiments.paper.published_numbers import PAPER, PaperExample
from surrogate.figures import close_up, meshes_and_errors
from surrogate.learning.data import Geometry
from surrogate.learning.measures import find_example, tip_measures

Array = NDArray[np.float64]
CLOSE = 0.35  # m, extent of the close-up figures about the load
USUALLY = 0.9  # smallest share of the samples of each body that counts as usually


@dataclass(frozen=True)
class Example:
    """An example of the paper.

    Attributes
    ----------
    body : str
        Name of the body.
    run : str
        Name of the run that predicts it.
    load : str
        Description of the place of the load.
    along : (float, float)
        Range of the place along the body, as fractions of its length.
    paper : PaperExample
        Its numbers in the paper.
    """

    body: str
    run: str
    load: str
    along: tuple[float, float]
    paper: PaperExample


def example_of(case: str, place: str, load: str, along: tuple[float, float]) -> Example:
    """Example of the paper by its case and place; `load` and `along` describe the place."""
    paper = PAPER.networks[case]["deterministic"].examples[place]
    return Example(BODIES[case], f"{case}-det", load, along, paper)


EXAMPLES = {
    "beam": example_of("beam2d", "corner", "at the corner", (1, 1)),
    "lshape": example_of("lshape2d", "corner", "at the top corner", (1, 1)),
    "beam3d-end": example_of("beam3d", "end", "near the free end", (0.75, 1)),
    "beam3d-middle": example_of("beam3d", "middle", "in the middle region", (0.25, 0.75)),
}
RUNS = tuple(dict.fromkeys(example.run for example in EXAMPLES.values()))


def nodes_along(geometry: Geometry, along: tuple[float, float]) -> NDArray[np.bool_]:
    """Mask of the nodes between two fractions of the body's length in x, (n_nodes,)."""
    x = geometry.coordinates[:, 0]
    fraction = (x - x.min()) / np.ptp(x)
    return (fraction >= along[0] - 1e-9) & (fraction <= along[1] + 1e-9)


def sample_of(resources: Resources, example: Example) -> tuple[Array, Array, Array]:
    """Force, predicted and reference displacement of an example: (n_nodes, d) each, in N and m."""
    dataset = resources.dataset_of(example.run)
    geometry, test = dataset.geometry, dataset.nodal_test
    nodes = nodes_along(geometry, example.along)
    aim = example.paper.tip_displacement_m
    number = find_example(test.force, test.displacement, geometry.tip, nodes, aim)
    predicted = resources.predicted_test(example.run).mean
    return test.force[number], predicted[number], test.displacement[number]


def measure(resources: Resources) -> Findings:
    """Draw each example, and measure the error of its tip displacement."""
    result, rows = Findings(), []
    for name, example in EXAMPLES.items():
        geometry = resources.dataset_of(example.run).geometry
        force, predicted, reference = sample_of(resources, example)
        moved, error = tip_measures(predicted, reference, geometry.tip)
        mean_error = MM * float(np.abs(predicted - reference).mean())
        loaded, newtons = np.flatnonzero(force.any(axis=1)), float(np.linalg.norm(force))
        place = ", ".join(f"{x:.2f}" for x in geometry.coordinates[loaded][0])
        what = f"{example.body}, load {example.load}"
        follows = float(error_correlation(predicted, reference, ~geometry.clamped))
        tips = moved, example.paper.tip_displacement_m
        rows.append((what, place, newtons, *tips, mean_error, follows))
        percent = 100 * error, 100 * example.paper.relative_tip_error
        result.comparisons.append(compare(f"{what}: relative tip error", "%", *percent))
        caption = f"{example.body}, {newtons:.2f} N at ({place}) m, tip displacement {moved:.2f} m"
        result.figures[name] = (
            meshes_and_errors(geometry, predicted, reference, force, "U-Net"),
            f"{caption}. Left: meshes. Right: nodal error on the predicted mesh.",
        )
        if geometry.dimension == 3:
            result.figures[f"{name}-close"] = (
                close_up(geometry, predicted, reference, loaded, CLOSE, "U-Net"),
                f"{caption}. Meshes close to the loaded node (dot).",
            )
    head = (
        "example",
        "load at [m]",
        "‖F‖ [N]",
        "tip displacement [m]",
        "in the paper [m]",
        "e_m [mm]",
        "rank correlation",
    )
    caption = (
        "For each example, the test sample whose tip displacement is closest to the paper's. Last "
        "column: Spearman's rank correlation of nodal error and displacement over the free nodes."
    )
    result.tables.append(Table(caption=caption, head=head, rows=tuple(rows)))
    correlations = {run: split_correlations(resources, run) for run in RUNS}
    by_body = {BODIES[resources.case_of(run)]: values for run, values in correlations.items()}
    result.claims.append(pattern_claim(by_body))
    return result


def pattern_claim(follows: dict[str, Array]) -> Claim:
    """Claim on the rank correlations of nodal error and displacement, (M,) of each body."""
    shares = {body: float((values > 0).mean()) for body, values in follows.items()}
    percents = ", ".join(
        f"{100 * share:.3g} % ({body}, {follows[body].mean():.2f} on average)"
        for body, share in shares.items()
    )
    return Claim(
        what="Errors are usually higher near the nodes with higher displacement magnitudes.",
        holds=min(shares.values()) >= USUALLY,
        evidence="Test samples in which the rank correlation of nodal error and displacement is "
        f"positive: {percents} (≥ {100 * USUALLY:g} % of each body).",
    )


STUDY = Experiment(
    name="single-predictions",
    title="Single predictions of deterministic U-Nets",
    labels=("2d_beam_test", "2d_L_test", "fig: 3d_test"),
    question="How close are the predictions to the finite element solutions, and where are the "
    "errors?",
    measure=measure,
    runs=RUNS,
)
