"""Time of a prediction beside the finite elements' (Table "prediction_times")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from surrogate.hardware import hardware
from surrogate.prediction import PASSES, load
from surrogate.studies.accuracy import BODIES
from surrogate.studies.record import Cell, Claim, Comparison, Table, compare
from surrogate.studies.study import Outcome, Study
from surrogate.studies.timing import prediction_seconds, solving_seconds
from surrogate.studies.workshop import Workshop

MS = 1e3  # in a second
DETERMINISTIC = {case: f"{case}-det" for case in BODIES}
BAYESIAN = {case: f"{case}-vb" for case in ("beam2d", "lshape2d")}
REAL_TIME = 10.0  # ms, the paper's limit


@dataclass(frozen=True)
class Times:
    """A row of the table, in ms.

    Attributes
    ----------
    solving : float
        Finite elements, a typical load.
    slowest : float or None
        The load that took longest.
    cpu : float
        Network.
    gpu : float or None
    """

    solving: float
    slowest: float | None
    cpu: float
    gpu: float | None

    def cells(self) -> tuple[Cell, ...]:
        """Times and ratios as the table has them."""
        by_gpu = None if self.gpu is None else self.solving / self.gpu
        times = (self.solving, self.slowest, self.cpu, self.gpu)
        return *times, self.solving / self.cpu, by_gpu


PAPER = {
    "beam2d": Times(123, None, 5, 1),
    "lshape2d": Times(120, None, 7, 1),
    "beam3d": Times(3100, None, 100, 9),
}
PAPER_PASSES = 100.0  # ms for 300 of them (Section "Prediction and training times")


CPU = torch.device("cpu")


def conduct(workshop: Workshop) -> Outcome:
    """Time predictions of one load, and take the solver's times from the datasets."""
    here = {case: times(workshop, run) for case, run in DETERMINISTIC.items()}
    passes = {case: network_ms(workshop, run, workshop.device) for case, run in BAYESIAN.items()}
    comparisons: list[Comparison] = []
    claims = []
    for case, paper in PAPER.items():
        name, found = BODIES[case], here[case]
        claims.append(faster(name, found, paper))
        comparisons.append(compare(f"{name}: t_CPU", "ms", found.cpu, paper.cpu))
        if found.gpu is not None and paper.gpu is not None:
            comparisons.append(compare(f"{name}: t_GPU", "ms", found.gpu, paper.gpu))
            claims.append(real_time(name, found.gpu, paper.gpu))
    for case, found_ms in passes.items():
        name = f"{BODIES[case]}: {PASSES} passes"
        comparisons.append(compare(name, "ms", found_ms, PAPER_PASSES))
    return Outcome([times_table(here), passes_table(passes, workshop.device)], comparisons, claims)


def network_ms(workshop: Workshop, run: str, device: torch.device) -> float:
    """Time of one prediction, of all passes of a Bayesian network, in ms."""
    surrogate = load(workshop.trained(run).folder, device.type)
    force = workshop.dataset_of(run).nodal_test.force[0]
    return MS * prediction_seconds(surrogate, force, PASSES)


def times(workshop: Workshop, run: str) -> Times:
    """The row of a deterministic network."""
    solving = MS * solving_seconds(workshop.nodal_folder(workshop.scale.runs[run].data))
    is_gpu = workshop.device.type == "cuda"
    return Times(
        float(np.median(solving)),
        float(solving.max()),
        network_ms(workshop, run, CPU),
        network_ms(workshop, run, workshop.device) if is_gpu else None,
    )


def times_table(here: dict[str, Times]) -> Table:
    """Finite elements and deterministic networks."""
    rows: list[tuple[Cell, ...]] = []
    for case, paper in PAPER.items():
        rows += [(BODIES[case], "here", *here[case].cells())]
        rows += [(BODIES[case], "paper", *paper.cells())]
    return Table(
        caption="Time of one solution, t_FEM: median and largest over the dataset's load cases, "
        "each solved by one process on the machine that made the dataset; and of one prediction "
        f"by deterministic networks, NumPy arrays in and out, on {hardware(CPU)}, and on a GPU "
        "where there is one.",
        head=(
            "example",
            "",
            "t_FEM [ms]",
            "largest t_FEM [ms]",
            "t_CPU [ms]",
            "t_GPU [ms]",
            "t_FEM / t_CPU",
            "t_FEM / t_GPU",
        ),
        rows=tuple(rows),
    )


def passes_table(passes: dict[str, float], device: torch.device) -> Table:
    """Bayesian networks."""
    rows = [(BODIES[case], ms, ms / PASSES) for case, ms in passes.items()]
    return Table(
        caption=f"Time of one Bayesian prediction, {PASSES} passes, on {hardware(device)}.",
        head=("example", "all passes [ms]", "one pass [ms]"),
        rows=(*rows, ("both, paper", PAPER_PASSES, PAPER_PASSES / PASSES)),
    )


def faster(name: str, found: Times, paper: Times) -> Claim:
    """Whether the network is faster than the finite elements on a CPU."""
    return Claim(
        what=f"{name}: on a CPU the network is faster than the finite elements.",
        holds=found.cpu < found.solving,
        evidence=f"{found.solving / found.cpu:.3g} times, {found.cpu:.3g} against "
        f"{found.solving:.3g} ms; the paper: {paper.solving / paper.cpu:.3g} times, {paper.cpu:g} "
        f"against {paper.solving:g} ms.",
    )


def real_time(name: str, found: float, paper: float) -> Claim:
    """Whether a prediction on a GPU keeps the paper's limit; times in ms."""
    return Claim(
        what=f"{name}: a prediction on a GPU takes no more than {REAL_TIME:g} ms.",
        holds=found <= REAL_TIME,
        evidence=f"{found:.3g} ms; the paper: {paper:g} ms.",
    )


STUDY = Study(
    name="prediction-times",
    title="Time of a prediction",
    labels=("Tab: prediction_times",),
    question="How much sooner than finite elements does a network answer?",
    conduct=conduct,
    runs=(*DETERMINISTIC.values(), *BAYESIAN.values()),
    times=True,
)
