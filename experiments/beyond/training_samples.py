"""Error over the number of training samples, for networks and regressions."""

from __future__ import annotations

from typing import NamedTuple

from experiments.beyond.error_curves import Curve, draw_curves
from experiments.beyond.networks import BODIES, KINDS, Kind, kind_of
from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Cell, Table
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import MM, split_errors

SERIES = "*-n[0-9]*"


class Point(NamedTuple):
    """Error ē in mm, and minutes of training, of a run."""

    error: float
    minutes: float


Series = dict[str, dict[int, Point]]  # by the label of the kind, then by the number of samples


def measure(resources: Resources) -> Findings:
    """Measure the errors of all series of the scale on their test splits."""
    result, scale = Findings(), resources.scale
    found: dict[str, Series] = {}
    for run in scale.matching((SERIES,)):
        count = scale.config_of(run).training.samples
        assert count is not None
        series = found.setdefault(BODIES[resources.case_of(run)], {})
        error = MM * split_errors(resources, run).mean_error
        point = Point(error, resources.run_record(run).minutes)
        series.setdefault(kind_of(run).label, {})[count] = point
    kinds = {kind.label: kind for kind in KINDS.values()}
    for body, series in found.items():
        result.tables += [series_table(body, series, minutes) for minutes in (False, True)]
    result.figures["errors"] = (
        draw_curves(
            {body: curves(series, kinds) for body, series in found.items()},
            "training samples",
            "mean error [mm]",
            log=(True, True),
        ),
        "Mean error on the same test split over the number of training samples.",
    )
    return result


def curves(series: Series, kinds: dict[str, Kind]) -> list[Curve]:
    """Curves of the errors of a body."""
    return [
        Curve(sorted(points), [points[n].error for n in sorted(points)], kinds[label])
        for label, points in series.items()
    ]


def series_table(body: str, series: Series, minutes: bool) -> Table:
    """Table of the errors of a body, or of the minutes of training, by number of samples."""
    counts = sorted({n for points in series.values() for n in points})
    rows: list[tuple[Cell, ...]] = [
        (label, *((points[n][minutes] if n in points else None) for n in counts))
        for label, points in series.items()
    ]
    what = "minutes of training or fitting" if minutes else "mean error ē on the test split in mm"
    return Table(
        caption=f"{body}: {what}, by the number of training samples (validation and calibration "
        "samples included).",
        head=("network", *map(str, counts)),
        rows=tuple(rows),
    )


STUDY = Experiment(
    name="training-samples",
    title="Error over the number of training samples",
    question="How many samples do networks and regressions need, with linear elasticity inside and "
    "without?",
    measure=measure,
    runs=(SERIES,),
)
