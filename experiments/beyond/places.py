"""Error by the place of a single load: a map on the body, and by distance from the training's."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm
from numpy.typing import NDArray

from experiments.beyond.body_maps import draw_maps
from experiments.beyond.error_curves import Curve, draw_curves
from experiments.beyond.networks import (
    BODIES,
    kind_of,
    patterns,
    runs_by_body,
    stem_of,
)
from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Table
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import MM
from experiments.measures.predicted_samples import (
    PredictedSamples,
    distance_from,
    distance_groups,
    predicted_samples,
)

Array = NDArray[np.float64]
COMPARED = ("forces", "mechanics", "reduced")
STEMS = tuple(stem_of(case) for case in BODIES)


def measure(resources: Resources) -> Findings:
    """Measure errors by place on every body of the scale."""
    result, scale = Findings(), resources.scale
    panels: dict[str, list[Curve]] = {}
    for case, runs in runs_by_body(scale, COMPARED).items():
        stem, body = stem_of(case), BODIES[case]
        dataset = f"{stem}_places"
        if dataset not in scale.datasets:
            continue
        singles = [run for kind in COMPARED if (run := f"{stem}-{kind}") in scale.runs]
        samples = {run: predicted_samples(resources, run, dataset) for run in (*runs, *singles)}
        maps = {label_of(run): MM * by_node(found, found.error) for run, found in samples.items()}
        result.tables.append(place_table(body, samples))
        geometry, errors = next(iter(samples.values())).geometry, np.stack([*maps.values()])
        scale_of_errors = LogNorm(np.nanmin(errors), np.nanmax(errors))
        result.figures[f"map-{stem}"] = (
            draw_maps(geometry, maps, scale_of_errors, "mean error [mm]"),
            f"{body}: mean error under single loads on each node, at the place of the load.",
        )
        if singles:
            trained = resources.structured(stem).geometry.loadable
            groups = distance_groups(distance_from(samples[singles[0]], trained))
            result.tables.append(distance_table(body, samples, groups))
            panels[body] = [curve(run, found, groups) for run, found in samples.items()]
    if panels:
        result.figures["distance"] = (
            draw_curves(
                panels,
                "distance of the load from those of single-load training [m]",
                "mean error [mm]",
            ),
            "Mean error under single loads over the distance of the load from the nodes that the "
            "paper's training loads; dashed, networks trained there only.",
        )
    return result


def label_of(run: str) -> str:
    """Label of a network with its training loads."""
    return kind_of(run).label + ("" if run.partition("-")[0] in BODIES else ", single loads")


def by_node(samples: PredictedSamples, values: Array) -> Array:
    """Mean of values (M,) over the samples that load a node, (n_nodes,); NaN where none does."""
    loaded = samples.loaded
    with np.errstate(invalid="ignore"):
        result: Array = (loaded * values[:, None]).sum(axis=0) / loaded.sum(axis=0)
    return result


def relative_by_node(samples: PredictedSamples) -> Array:
    """Mean error over mean displacement under loads on a node, (n_nodes,)."""
    return by_node(samples, samples.error) / by_node(samples, samples.moved)


def curve(
    run: str, samples: PredictedSamples, groups: list[tuple[float, NDArray[np.bool_]]]
) -> Curve:
    """Curve of the mean error over the distance."""
    distances = [distance for distance, _ in groups]
    errors = [MM * float(samples.error[group].mean()) for _, group in groups]
    style = "-" if run.partition("-")[0] in BODIES else "--"
    return Curve(distances, errors, kind_of(run), style, label_of(run))


def place_table(body: str, samples: dict[str, PredictedSamples]) -> Table:
    """Table of the errors over the places."""
    things = [
        (label_of(run), MM * by_node(found, found.error), relative_by_node(found))
        for run, found in samples.items()
    ]
    return Table.of(
        f"{body}: mean error under single random loads on a node, over all nodes; in the "
        "last column over the mean displacement under loads on the same node.",
        things,
        {
            "network": lambda of: of[0],
            "mean [mm]": lambda of: float(np.nanmean(of[1])),
            "median node [mm]": lambda of: float(np.nanmedian(of[1])),
            "best node [mm]": lambda of: float(np.nanmin(of[1])),
            "worst node [mm]": lambda of: float(np.nanmax(of[1])),
            "worst node, relative [%]": lambda of: 100 * float(np.nanmax(of[2])),
        },
    )


def distance_table(
    body: str,
    samples: dict[str, PredictedSamples],
    groups: list[tuple[float, NDArray[np.bool_]]],
) -> Table:
    """Table of the errors by distance."""
    return Table(
        caption=f"{body}: mean error in mm under single loads, by the distance of the load from "
        "the nodes that are loaded in single-load training.",
        head=("network", *(f"{distance:.2f} m" for distance, _ in groups)),
        rows=tuple(
            (label_of(run), *(MM * float(found.error[group].mean()) for _, group in groups))
            for run, found in samples.items()
        ),
    )


STUDY = Experiment(
    name="places",
    title="Error by the place of the load",
    question="Where on the body must a load act to be predicted badly, and how far from what the "
    "training loaded?",
    measure=measure,
    datasets=("*_places", *STEMS),
    runs=patterns((*BODIES, *STEMS), COMPARED),
)
