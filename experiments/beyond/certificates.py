"""Certificates: estimated against true errors, alarms, corrections, and what each costs."""

from __future__ import annotations

import warnings

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from experiments.beyond.error_curves import HEIGHT, WIDTH
from experiments.beyond.networks import BODIES, kind_of, patterns, stem_of
from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Cell, Table
from experiments.framework.resources import Resources
from experiments.framework.timing import median_seconds
from experiments.measures.alarms import alarms, auroc_of_errors, judge, judge_unusual
from experiments.measures.certificates import WITHIN, Certified, certified, fast_measures
from experiments.measures.corrections import PREDICTION, ZERO, newton_starts
from experiments.measures.errors_on_test_split import MM
from shared_schema.common import InputError
from shared_schema.common.drawing import make_figure, styled
from surrogate import OutsideTrainingWarning
from surrogate.learning.inference import fit_fast_certificate
from surrogate.learning.measures import sample_errors
from surrogate.mechanics.certify import certify

Array = NDArray[np.float64]
PREDICTED = (
    "mechanics",
    "reduced",
    "mechanics-mle",
    "mechanics-vb",
    "mechanics-ensemble",
    "modal-gp",
)
SINGLE = ("forces", "forces-mle", "forces-vb", "forces-ensemble", "reduced")  # on single loads
STEMS = tuple(stem_of(case) for case in BODIES)
SAMPLES = {2: 300, 3: 60}  # of the test split, by the dimension of the body
SOLVED = {2: 100, 3: 12}  # loads that are brought to equilibrium from every start
PASSES = 20  # of stochastic networks, under the unusual loads
TOLERANCE = 1e-3  # error e_m in m that an alarm should be given for
MS = 1e3


def measure(resources: Resources) -> Findings:
    """Measure everything on every run of the scale that has a mesh to certify on."""
    runs = resources.scale.matching(STUDY.runs)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OutsideTrainingWarning)
        found = {run: certified_samples(resources, run) for run in runs}
        result = Findings(
            [
                estimate_table(resources, found),
                correction_table(resources, found),
                fast_table(resources, found),
                *alarm_tables(resources, found),
                error_alarm_table(resources, found),
                start_table(resources, found),
            ]
        )
    result.figures["estimates"] = (
        draw(resources, found),
        "Estimated over true mean error of every load of the test splits.",
    )
    return result


def label(resources: Resources, run: str) -> str:
    """Body, network and training loads of a run."""
    case = resources.case_of(run)
    stem = stem_of(case)
    body = next(name for other, name in BODIES.items() if stem_of(other) == stem)
    single = "" if case in BODIES else ", single loads"
    return f"{body}, {kind_of(run).label}{single}"


def certified_samples(resources: Resources, run: str) -> Certified:
    """Certify the predictions of a run on its test split."""
    surrogate, test = resources.surrogate(run), resources.dataset_of(run).nodal_test
    count = SAMPLES[test.force.shape[2]]
    predicted = resources.predicted_test(run).mean[:count]
    return certified(surrogate, test.force[:count], test.displacement[:count], predicted)


def percent_cell(ratio: float) -> Cell:
    """Cell of a percentile of effectivities, which may be infinite."""
    return ratio if np.isfinite(ratio) else "∞"


def estimate_table(resources: Resources, found: dict[str, Certified]) -> Table:
    """Table of estimated against true errors."""

    def milliseconds(one: Certified) -> float:
        force, u, equilibrium = one.force[:20], one.predicted[:20], one.surrogate.body.equilibrium
        seconds = median_seconds(lambda: certify(equilibrium, force, u), resources.scale.timing)
        return MS * seconds / len(force)

    things = [(run, one, one.measures()) for run, one in found.items()]
    return Table.of(
        "Estimated over true mean error (effectivity) on the test split, their rank "
        "correlation, the share of estimates that settle, and the wall time of a certificate in "
        "batches of 20.",
        things,
        {
            "network": lambda of: label(resources, of[0]),
            "ē [mm]": lambda of: MM * of[2]["mean_error"],
            "5 %": lambda of: percent_cell(of[2]["effectivity_percentiles"]["5"]),
            "median": lambda of: percent_cell(of[2]["effectivity_percentiles"]["50"]),
            "95 %": lambda of: percent_cell(of[2]["effectivity_percentiles"]["95"]),
            f"within {WITHIN[0]:g} to {WITHIN[1]:g} [%]": lambda of: (
                100 * of[2]["within_0.8_and_1.5"]
            ),
            "Spearman": lambda of: of[2]["spearman"],
            "settled [%]": lambda of: 100 * of[2]["settled"],
            "time [ms]": lambda of: milliseconds(of[1]),
        },
    )


def correction_table(resources: Resources, found: dict[str, Certified]) -> Table:
    """Table of the errors before and after corrections."""
    things = [(label(resources, run), one.measures()) for run, one in found.items()]
    before, once = "median_error_before", "median_error_without_estimate"
    return Table.of(
        "Median error in mm of the predictions, and after their estimated error is "
        "subtracted once and twice; how many times smaller it is after one correction, and how "
        "many loads have a larger error then.",
        things,
        {
            "network": lambda of: of[0],
            "before": lambda of: MM * of[1][before],
            "once": lambda of: MM * of[1][once],
            "twice": lambda of: MM * of[1]["median_error_after_two"],
            "ratio": lambda of: of[1][before] / of[1][once],
            "raised": lambda of: of[1]["raised"],
        },
    )


def fast_table(resources: Resources, found: dict[str, Certified]) -> Table:
    """Table of fast certificates: coverage, width and time."""
    things = []
    for run, one in found.items():
        if one.surrogate.is_stochastic:
            continue
        try:
            fast = fit_fast_certificate(one.surrogate, resources.dataset_of(run), 1, 0)
        except InputError:  # no held-out samples
            continue
        measures = fast_measures(fast, one, one.truth, resources.scale.timing)
        bounds = {entry["level"]: entry for entry in measures["test_split"]["mean"]}
        if len(bounds) > 1:
            things.append((label(resources, run), measures, bounds[0.9], bounds[0.95]))
    return Table.of(
        "Fast certificates: held-out samples of the calibration, coverage of the bounds of "
        "90 and 95 % on the test split, their median ratio to the true error, rank correlation of "
        "estimated and true errors, and the wall time for a single load.",
        things,
        {
            "network": lambda of: of[0],
            "held out": lambda of: of[1]["test_split"]["samples"],
            "90 % covers [%]": lambda of: 100 * of[2]["coverage"],
            "95 % covers [%]": lambda of: 100 * of[3]["coverage"],
            "90 % width": lambda of: of[2]["median_width"],
            "95 % width": lambda of: of[3]["median_width"],
            "Spearman": lambda of: of[1]["spearman"],
            "time [ms]": lambda of: of[1]["median_milliseconds"],
        },
    )


def alarm_tables(resources: Resources, found: dict[str, Certified]) -> list[Table]:
    """Tables of the AUROC of unusual loads: networks of single loads, and of any loads."""
    groups = {
        "trained on single loads on a few nodes": [r for r in found if is_single(resources, r)],
        "trained on several loads on any node": [r for r in found if not is_single(resources, r)],
    }
    tables = []
    for what, runs in groups.items():
        rows: list[tuple[Cell, ...]] = []
        kinds: dict[str, None] = {}
        for run in runs:
            one = found[run]
            passes = min(PASSES, resources.scale.passes)
            inside = judge(one.surrogate, one.force, passes)
            areas = alarms(inside, judge_unusual(one.surrogate, one.force, passes))
            kinds |= dict.fromkeys(areas)
            scores = dict.fromkeys(name for of_kind in areas.values() for name in of_kind)
            rows += [
                (label(resources, run), name, *(areas[kind].get(name) for kind in areas))
                for name in scores
            ]
        tables.append(
            Table(
                caption=f"AUROC of alarms for loads outside the training, networks {what}: the "
                "probability that the score of such a load is above that of a load of the test "
                "split.",
                head=("network", "alarm", *kinds),
                rows=tuple(rows),
            )
        )
    return tables


def is_single(resources: Resources, run: str) -> bool:
    """True if a run was trained on single loads on a few nodes."""
    return resources.case_of(run) not in BODIES


def error_alarm_table(resources: Resources, found: dict[str, Certified]) -> Table:
    """Table of the AUROC of errors above a tolerance, wherever the load comes from."""
    rows: list[tuple[Cell, ...]] = []
    for run, one in found.items():
        dataset = f"{stem_of(resources.case_of(run))}_many"
        if dataset not in resources.scale.datasets or is_single(resources, run):
            continue
        loads = resources.predicted_loads(run, dataset)
        count = SAMPLES[one.dimension]
        force, truth = loads.samples.force[:count], loads.samples.displacement[:count]
        error = sample_errors(loads.predicted.mean[:count], truth)
        judged = judge(one.surrogate, force, min(PASSES, resources.scale.passes))
        rows += [
            (
                label(resources, run),
                name,
                100 * float((error > TOLERANCE).mean()),
                auroc_of_errors(error, score, TOLERANCE),
            )
            for name, score in judged.scores.items()
        ]
    return Table(
        caption=f"AUROC of alarms for errors e_m above {MM * TOLERANCE:g} mm, under one to eight "
        "loads on any node: for networks of any loads, an unusual load need not be predicted "
        "wrongly.",
        head=("network", "alarm", "wrong [%]", "AUROC"),
        rows=tuple(rows),
    )


def start_table(resources: Resources, found: dict[str, Certified]) -> Table:
    """Table of Newton's method from several starts, one network a body."""
    rows: list[tuple[Cell, ...]] = []
    seen = set()
    for run, one in found.items():
        case = resources.case_of(run)
        if case in seen or is_single(resources, run):
            continue
        seen.add(case)
        count = SOLVED[one.dimension]
        efforts = newton_starts(
            one.surrogate.body.equilibrium, one.force[:count], one.predicted[:count]
        )
        for name, effort in efforts.items():
            rows.append(
                (
                    label(resources, run),
                    name,
                    float(effort.iterations.mean()),
                    float(effort.iterations.max()),
                    MS * float(np.median(effort.seconds)),
                    effort.lost,
                )
            )
    return Table(
        caption="Newton's method with line search to 1e-8 N: iterations, processor time of one "
        f"thread (median) and load cases that are lost, from the {ZERO}, from the linear response, "
        f"and from the {PREDICTION} (these two and the prediction).",
        head=("network", "start", "iterations", "most", "time [ms]", "lost"),
        rows=tuple(rows),
    )


@styled
def draw(resources: Resources, found: dict[str, Certified]) -> Figure:
    """Draw estimated over true errors, a panel a body."""
    panels: dict[str, list[str]] = {}
    for run in found:
        panels.setdefault(label(resources, run).partition(",")[0], []).append(run)
    figure = make_figure(WIDTH, HEIGHT * len(panels))
    axes_of = figure.subplots(len(panels), 1, squeeze=False)[:, 0]
    for axes, (body, runs) in zip(axes_of, panels.items(), strict=True):
        ends = np.concatenate([MM * found[run].errors[0] for run in runs])
        axes.plot([ends.min(), ends.max()], [ends.min(), ends.max()], color="0.6", lw=0.8)
        for run in runs:
            one, kind = found[run], kind_of(run)
            style = {"ls": "", "marker": kind.marker, "color": kind.color, "ms": 2.5, "alpha": 0.6}
            name = label(resources, run).partition(", ")[2]
            true, estimated = one.errors[0], one.certificate.mean_error
            axes.loglog(MM * true, MM * estimated, label=name, **style)
        axes.set_title(body, fontsize=10)
        axes.set_ylabel("estimated error [mm]")
        axes.legend(fontsize=7)
    axes_of[-1].set_xlabel("true error [mm]")
    return figure


STUDY = Experiment(
    name="certificates",
    title="Certificates",
    question="How well does the certificate of a prediction know its error, which loads does it "
    "give an alarm for, and what do corrections gain?",
    measure=measure,
    datasets=("*_many",),
    runs=patterns(tuple(BODIES), PREDICTED) + patterns(STEMS, SINGLE),
    times=True,
)
