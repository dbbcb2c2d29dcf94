"""Time of a prediction by every kind of network, beside that of a solution by `datagen`."""

from __future__ import annotations

import numpy as np

from experiments.beyond.coverage import UNCERTAIN
from experiments.beyond.loads_by_number import COMPARED
from experiments.beyond.networks import BODIES, KINDS, kind_of, patterns, runs_by_body
from experiments.components.speed_up import CPU
from experiments.framework.resources import Resources
from experiments.framework.study import Study, StudyResult
from experiments.framework.study_record import Cell, Claim, Table
from experiments.framework.timing import prediction_seconds, read_solutions
from surrogate.hardware import hardware
from surrogate.inference.loading import load

MS = 1e3  # ms in a second
TIMED = tuple(dict.fromkeys((*COMPARED, "gp", *UNCERTAIN)))
FASTER = 1.0  # smallest ratio of the times of a solution and a prediction


def measure(resources: Resources) -> StudyResult:
    """Time predictions of the first test sample on a CPU; take solutions' from the datasets."""
    rows: list[tuple[Cell, ...]] = []
    claims = []
    passes, timing = resources.scale.passes, resources.scale.timing
    for case, runs in runs_by_body(resources.scale, TIMED).items():
        nodal = resources.nodal_folder(resources.scale.runs[runs[0]].data)
        solving = MS * float(np.median(read_solutions(nodal).seconds))
        for run in runs:
            force = resources.dataset_of(run).nodal_test.force[0]
            surrogate = load(resources.trained(run).folder, CPU.type)
            ms = MS * prediction_seconds(surrogate, force, passes, timing)
            made = passes if surrogate.is_stochastic else None
            rows.append((BODIES[case], kind_of(run).label, made, ms, solving, solving / ms))
            if kind_of(run) in (KINDS["mechanics"], KINDS["reduced"]):
                claims.append(faster(f"{BODIES[case]}, {kind_of(run).label}", solving, ms))
    table = Table(
        caption="Time of one prediction, one load in and one field out, NumPy arrays both, on "
        f"{hardware(CPU)}: median; of stochastic networks all passes, their weights kept from the "
        "prediction before. Time of a solution: median of the wall times that the dataset keeps of "
        "its load cases, on the machine that made it. Both in one run, for the networks of the "
        "package: `docs/benchmarks/trained.md`.",
        head=("example", "network", "passes", "prediction [ms]", "solution [ms]", "ratio"),
        rows=tuple(rows),
    )
    return StudyResult([table], claims=claims)


def faster(name: str, solving: float, predicting: float) -> Claim:
    """Claim that a prediction takes less time than a solution; times in ms."""
    return Claim(
        what=f"{name}: a prediction takes less time than a solution by finite elements.",
        holds=solving / predicting > FASTER,
        evidence=f"{predicting:.3g} and {solving:.3g} ms, {solving / predicting:.3g} times.",
        of_paper=False,
    )


STUDY = Study(
    name="times",
    title="Time of a prediction by every kind of network",
    labels=(),
    question="How long does a prediction take, and how long a solution by the finite elements?",
    measure=measure,
    runs=patterns(tuple(BODIES), TIMED),
    times=True,
)
