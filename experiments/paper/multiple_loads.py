"""Several loads at once on a network trained on single loads (Figure "multiple_force")."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Claim, Table, compare
from experiments.framework.resources import Resources
from experiments.measures.error_displacement_correlation import (
    error_correlation,
    split_correlations,
)
from experiments.measures.errors_on_test_split import MM, split_errors
from experiments.paper.published_numbers import PAPER
from surrogate import Surrogate
from surrogate.figures import meshes_and_errors
from surrogate.learning.data import Geometry, NodalSamples
from surrogate.learning.measures import Extrapolation, find_example, tip_measures
from surrogate.learning.measures import measure as measure_errors

Array = NDArray[np.float64]
RUN, LOADS = "beam2d-det", "beam2d_multiple"
CLOSELY = 0.05  # largest median relative tip error
LESS = 0.1  # smallest drop of the rank correlation that counts as another trend


def measure(resources: Resources) -> Findings:
    """Draw the example, and measure errors under single and under several loads."""
    loads = resources.predicted_loads(RUN, LOADS)
    geometry, samples, predicted = loads.surrogate.geometry, loads.samples, loads.predicted.mean
    number = find_papers_example(samples, geometry)
    paper = PAPER.multiple_loads
    force, reference = samples.force[number], samples.displacement[number]
    under_one = split_correlations(resources, RUN)
    under_several = error_correlation(predicted, samples.displacement, ~geometry.clamped)
    tips = [
        tip_measures(*fields, geometry.tip)
        for fields in zip(predicted, samples.displacement, strict=True)
    ]
    moved, error = tips[number]
    newtons = ", ".join(f"{size:.2f}" for size in load_norms(force, geometry.coordinates))
    return Findings(
        tables=[error_table(resources, loads)],
        comparisons=[
            compare(
                f"relative tip error at {moved:.2f} m (paper: {paper.tip_displacement_m} m)",
                "%",
                100 * error,
                100 * paper.relative_tip_error,
            )
        ],
        claims=[
            accuracy_claim(np.array([error for _, error in tips])),
            pattern_claim(float(under_one.mean()), float(under_several.mean())),
        ],
        figures={
            "example": (
                meshes_and_errors(geometry, predicted[number], reference, force, "U-Net"),
                f"2D beam under forces of {newtons} N (from the clamped end), its network trained "
                f"on single ones; tip displacement {moved:.2f} m. Left: meshes. Right: nodal error "
                "on the predicted mesh.",
            )
        },
    )


def find_papers_example(samples: NodalSamples, geometry: Geometry) -> int:
    """Find the sample with the tip displacement nearest to that of the paper's example."""
    return find_example(
        samples.force,
        samples.displacement,
        geometry.tip,
        geometry.loadable,
        PAPER.multiple_loads.tip_displacement_m,
    )


def error_table(resources: Resources, loads: Extrapolation) -> Table:
    """Table of errors under one load, several loads, and of the superposition of predictions."""
    geometry, samples = loads.surrogate.geometry, loads.samples
    several = measure_errors(
        samples.force, loads.predicted.mean, samples.displacement, geometry.tip
    )
    superposed = measure_errors(
        samples.force,
        superposition(loads.surrogate, samples.force),
        samples.displacement,
        geometry.tip,
    )
    measured = {
        "one": split_errors(resources, RUN),
        "several": several,
        "several, superposition of single predictions": superposed,
    }
    rows = tuple(
        (name, e.samples, MM * e.mean_error, MM * e.std_error, 100 * e.relative_tip_error_median)
        for name, e in measured.items()
    )
    counts = samples.force.any(axis=2).sum(axis=1)
    one = max(map(abs, resources.dataset_of(RUN).manifest.case["load"]["range"]))
    more = max(map(abs, resources.manifest(LOADS).case["load"]["range"]))
    return Table(
        caption="Errors of the deterministic U-Net. One: test split, force components within "
        f"±{one:g} N. Several: forces on {counts.min()} to {counts.max()} of the "
        f"{geometry.loadable.sum()} loadable nodes, components within ±{more:g} N.",
        head=("loads", "M", "ē [mm]", "σ(e) [mm]", "median relative tip error [%]"),
        rows=rows,
    )


def superposition(surrogate: Surrogate, force: Array) -> Array:
    """Sum of the predictions for each load alone: forces in N to displacements in m."""
    sample, node = np.nonzero(force.any(axis=2))
    single = np.zeros((len(node), *force.shape[1:]))
    single[np.arange(len(node)), node] = force[sample, node]
    total = np.zeros_like(force)
    np.add.at(total, sample, surrogate.predict(single))
    return total


def load_norms(force: Array, coordinates: Array) -> Array:
    """Norms ‖F‖ of the loads of a sample (n_nodes, d) in N, in the order of x: (n_loads,)."""
    newtons: Array = np.linalg.norm(force, axis=1)[np.argsort(coordinates[:, 0], kind="stable")]
    return newtons[newtons > 0]


def accuracy_claim(tip_errors: Array) -> Claim:
    """Claim on the relative tip errors (M,) under several loads."""
    papers = PAPER.multiple_loads.relative_tip_error
    median, below = float(np.median(tip_errors)), int((tip_errors < papers).sum())
    return Claim(
        what="Trained on single loads, the network closely follows the solution under several.",
        holds=median <= CLOSELY,
        evidence=f"Median relative tip error {100 * median:.3g} % (≤ {100 * CLOSELY:g} %); "
        f"{below} of {len(tip_errors)} samples are below the {100 * papers:g} % of "
        "the paper's example.",
    )


def pattern_claim(single: float, several: float) -> Claim:
    """Claim on the mean rank correlations of nodal error and displacement."""
    return Claim(
        what=(
            "Under several loads the error shows a different trend: it is high not only where "
            "the deformation is."
        ),
        holds=several <= single - LESS,
        evidence=(
            "Mean rank correlation of nodal error and displacement: "
            f"{several:.2f} under several loads, {single:.2f} under one (by {LESS} less)."
        ),
    )


STUDY = Experiment(
    name="multiple-loads",
    title="Several loads at once",
    labels=("fig: multiple_force",),
    question="How does a network that is trained on single loads predict several at once?",
    measure=measure,
    datasets=(LOADS,),
    runs=(RUN,),
)
