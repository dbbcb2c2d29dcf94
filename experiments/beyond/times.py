"""Time of a prediction by every kind of network, beside that of a solution by `datagen`."""

from __future__ import annotations

import torch

from experiments.beyond.coverage import UNCERTAIN
from experiments.beyond.loads_by_number import COMPARED
from experiments.beyond.networks import BODIES, kind_of, patterns, runs_by_body
from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Cell, Table
from experiments.framework.resources import Resources
from experiments.measures.latency import prediction_seconds
from experiments.measures.solutions import typical_seconds
from surrogate import load
from surrogate.runtime.device import hardware

CPU = torch.device("cpu")
MS = 1e3  # ms in a second
TIMED = tuple(dict.fromkeys((*COMPARED, "gp", *UNCERTAIN)))


def measure(resources: Resources) -> Findings:
    """Time predictions of the first test sample on a CPU; take solutions' from the datasets."""
    rows: list[tuple[Cell, ...]] = []
    passes, timing = resources.scale.passes, resources.scale.timing
    for case, runs in runs_by_body(resources.scale, TIMED).items():
        nodal = resources.nodal_folder(resources.scale.runs[runs[0]].data)
        solving = MS * typical_seconds(nodal)
        for run in runs:
            force = resources.dataset_of(run).nodal_test.force[0]
            surrogate = load(resources.trained(run).folder, CPU.type)
            ms = MS * prediction_seconds(surrogate, force, passes, timing)
            made = passes if surrogate.is_stochastic else None
            rows.append((BODIES[case], kind_of(run).label, made, ms, solving, solving / ms))
    table = Table(
        caption="Time of one prediction, one load in and one field out, NumPy arrays both, on "
        f"{hardware(CPU)}: median; of stochastic networks all passes, their weights kept from the "
        "prediction before. Time of a solution: median of the wall times that the dataset keeps of "
        "its load cases, on the machine that made it. Both in one run, for the networks of the "
        "package: `docs/benchmarks/trained.md`.",
        head=("example", "network", "passes", "prediction [ms]", "solution [ms]", "ratio"),
        rows=tuple(rows),
    )
    return Findings([table])


STUDY = Experiment(
    name="times",
    title="Time of a prediction by every kind of network",
    question="How long does a prediction take, and how long a solution by the finite elements?",
    measure=measure,
    runs=patterns(tuple(BODIES), TIMED),
    times=True,
)
