"""Time of a prediction beside the finite elements' (Table "prediction_times")."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Cell, Claim, Comparison, Table, compare, join_named
from experiments.framework.resources import Resources
from experiments.framework.timing import alternating_seconds
from experiments.measures.errors_on_test_split import BODIES
from experiments.measures.latency import prediction, prediction_seconds
from experiments.measures.solutions import Solutions, read_solutions
from experiments.paper.published_numbers import PAPER
from surrogate import load
from surrogate.runtime.device import hardware

FASTER = {"CPU": 10, "GPU": 100}  # smallest speed-ups that agree with the paper's ratios
CPU = torch.device("cpu")
TENTH = 10  # reciprocal of the share of load cases that counts as small, and as large
GROWTH = 1.2  # smallest ratio of times that counts as growth; below, times are the same
PAPER_DEVICE = "not said; its GPU is a V100"
MS = 1e3  # ms in a second
DETERMINISTIC = {case: f"{case}-det" for case in BODIES}
BAYESIAN = {case: f"{case}-vb" for case in ("beam2d", "lshape2d")}


def measure(resources: Resources) -> Findings:
    """Time predictions, and take the solver's times from the datasets."""
    solutions = {
        case: read_solutions(resources.nodal_folder(resources.scale.runs[run].data))
        for case, run in DETERMINISTIC.items()
    }
    here = {case: measure_times(resources, case, found) for case, found in solutions.items()}
    passes = {case: measure_pass_times(resources, run) for case, run in BAYESIAN.items()}
    by_load = {
        case: measure_times_by_load(resources, case, found) for case, found in solutions.items()
    }
    comparisons: list[Comparison] = []
    claims: list[Claim] = []
    for case, paper in PAPER_TIMES.items():
        name, found = BODIES[case], here[case]
        for device, ms in found.network.items():
            comparisons.append(compare(f"{name}: t_{device}", "ms", ms, paper.network[device]))
            claims.append(faster(name, device, found, paper))
        if "GPU" in found.network:
            claims.append(real_time(name, found.network["GPU"], paper.network["GPU"]))
    if resources.scale.passes == PAPER.bayesian_prediction.passes:
        comparisons += pass_comparisons(passes)
    return Findings(
        tables=[
            times_table(here),
            load_table(by_load),
            pass_table(passes, resources.scale.passes, hardware(resources.device)),
        ],
        comparisons=comparisons,
        claims=[*claims, solving_grows(by_load), predicting_does_not(by_load)],
    )


def measure_times(resources: Resources, case: str, solutions: Solutions) -> Times:
    """Measure the row of a deterministic network, for the first test sample."""
    run = DETERMINISTIC[case]
    force = resources.dataset_of(run).nodal_test.force[0]
    devices = {"CPU": CPU}
    if resources.device.type == "cuda":
        devices["GPU"] = resources.device
    network = {name: network_ms(resources, run, force, device) for name, device in devices.items()}
    solving = MS * solutions.seconds
    return Times(float(np.median(solving)), float(solving.max()), network)


def measure_times_by_load(resources: Resources, case: str, solutions: Solutions) -> TimesByLoad:
    """Measure times of one body for small and large loads; D on a CPU, VB with kept weights."""
    force = resources.dataset_of(DETERMINISTIC[case]).nodal_test.force
    order = np.argsort(np.linalg.norm(force, axis=(1, 2)))
    runs = {"D": (DETERMINISTIC[case], CPU)}
    if case in BAYESIAN:
        runs["VB"] = BAYESIAN[case], resources.device
    passes, timing = resources.scale.passes, resources.scale.timing
    networks = {}
    for kind, (run, device) in runs.items():
        surrogate = load(resources.trained(run).folder, device.type)
        predictions = [prediction(surrogate, force[order[end]], passes) for end in (0, -1)]
        networks[kind] = Ends(*(MS * s for s in alternating_seconds(predictions, timing)))
    return TimesByLoad(*solving_ends(solutions), networks)


def measure_pass_times(resources: Resources, run: str) -> PassTimes:
    """Measure both times of a Bayesian network, for the first test sample."""
    force = resources.dataset_of(run).nodal_test.force[0]
    kept = network_ms(resources, run, force, resources.device, False)
    anew = network_ms(resources, run, force, resources.device, True)
    return PassTimes(resources.scale.passes * resources.scale.unet_of(run).ensemble, kept, anew)


def network_ms(
    resources: Resources,
    run: str,
    force: NDArray[np.float64],
    device: torch.device,
    drawn_anew: bool = False,
) -> float:
    """Measure the time of predicting one load in ms, all passes if the network is Bayesian."""
    surrogate = load(resources.trained(run).folder, device.type)
    scale = resources.scale
    return MS * prediction_seconds(surrogate, force, scale.passes, scale.timing, drawn_anew)


@dataclass(frozen=True)
class Times:
    """A row of the table, in ms.

    Attributes
    ----------
    solving : float
        Time of the finite elements for a typical load.
    slowest : float or None
        Time of the finite elements for the slowest load.
    network : dict of str to float
        Time of a prediction on the "CPU", and on the "GPU" where there is one.
    """

    solving: float
    slowest: float | None
    network: dict[str, float]

    def speed_up(self, device: str) -> float:
        """Ratio of the times of finite elements and network."""
        return self.solving / self.network[device]

    def describe(self, device: str) -> str:
        """Write the speed-up with both times."""
        times = f"{self.solving:.4g} / {self.network[device]:.4g} ms"
        return f"{self.speed_up(device):.3g} ({times})"

    def cells(self) -> tuple[Cell, ...]:
        """Cells of the row: times and ratios."""
        times = [self.network.get(device) for device in FASTER]
        ratios = [self.speed_up(d) if d in self.network else None for d in FASTER]
        return self.solving, self.slowest, *times, *ratios


PAPER_TIMES = {
    case: Times(paper.finite_elements_ms, None, {"CPU": paper.cpu_ms, "GPU": paper.gpu_ms})
    for case, paper in PAPER.prediction_times.items()
}


def times_table(here: Mapping[str, Times]) -> Table:
    """Table of the times of finite elements and deterministic networks."""
    rows: list[tuple[Cell, ...]] = []
    for case, paper in PAPER_TIMES.items():
        rows += [(BODIES[case], "here", *here[case].cells())]
        rows += [(BODIES[case], "paper", *paper.cells())]
    return Table(
        caption="Time of one solution by finite elements, t_FEM: median and largest of the "
        "wall times that the dataset keeps of its load cases, on the machine that made it, which "
        "it does not name (the paper's of the 3D beam: of some loads of its test set). Time of "
        "one prediction by a deterministic U-Net, NumPy arrays in and out: t_CPU on "
        f"{hardware(CPU)}, t_GPU where there is a GPU.",
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


def faster(name: str, device: str, found: Times, paper: Times) -> Claim:
    """Test whether the network is faster than the finite elements by the expected factor."""
    least, slowest = FASTER[device], ""
    if found.slowest is not None:
        slowest = f"; of the slowest load {found.slowest / found.network[device]:.4g}"
    return Claim(
        what=f"{name}: on a {device} the network is at least {least} times faster than the finite "
        "elements.",
        holds=found.speed_up(device) >= least,
        evidence=f"t_FEM / t_{device} = {found.describe(device)}{slowest}; the paper: "
        f"{paper.describe(device)}.",
    )


def real_time(name: str, found: float, paper: float) -> Claim:
    """Test whether a prediction on a GPU keeps the paper's limit; times in ms."""
    return Claim(
        what=f"{name}: a prediction on a GPU takes no more than {PAPER.real_time_ms:g} ms.",
        holds=found <= PAPER.real_time_ms,
        evidence=f"{found:.3g} ms; the paper: {paper:g} ms.",
    )


@dataclass(frozen=True)
class Ends:
    """A number under small and under large loads."""

    small: float
    large: float

    @property
    def ratio(self) -> float:
        """Ratio of large and small."""
        return self.large / self.small


@dataclass(frozen=True)
class TimesByLoad:
    """Effort of the solutions and predictions for one body.

    Attributes
    ----------
    solving : Ends
        Time of the finite elements in ms.
    iterations : Ends
        Number of Newton iterations.
    networks : dict of str to Ends
        Time of a prediction in ms, by the likelihood of the network, D or VB.
    """

    solving: Ends
    iterations: Ends
    networks: dict[str, Ends]


def solving_ends(solutions: Solutions) -> tuple[Ends, Ends]:
    """Medians of time in ms and Newton iterations, tenths with the smallest and largest ‖F‖."""
    order = np.argsort(solutions.force)
    count = max(1, len(order) // TENTH)

    def ends(values: NDArray[np.float64] | NDArray[np.int64]) -> Ends:
        return Ends(*(float(np.median(values[s])) for s in (order[:count], order[-count:])))

    return ends(1e3 * solutions.seconds), ends(solutions.iterations)


def load_table(times: Mapping[str, TimesByLoad]) -> Table:
    """Table of the times of all cases."""
    rows: list[tuple[Cell, ...]] = []
    for case, found in times.items():
        quantities = {"t_FEM [ms]": found.solving, "Newton iterations": found.iterations}
        quantities |= {f"prediction ({kind}) [ms]": ends for kind, ends in found.networks.items()}
        rows += [(BODIES[case], p, e.small, e.large, e.ratio) for p, e in quantities.items()]
    return Table(
        caption="Finite elements: medians over the tenths of the load cases with the smallest and "
        "with the largest ‖F‖. Deterministic U-Nets (D) on a CPU and Bayesian ones (VB, all "
        "passes, weights kept): the test samples with the smallest and with the largest ‖F‖.",
        head=("example", "", "small loads", "large loads", "ratio"),
        rows=tuple(rows),
    )


def solving_grows(times: Mapping[str, TimesByLoad]) -> Claim:
    """Test whether the finite elements take longer under larger loads, in every case."""
    ratios = {BODIES[case]: found.solving.ratio for case, found in times.items()}
    return Claim(
        what="The time of the finite elements grows with the force.",
        holds=min(ratios.values()) >= GROWTH,
        evidence=f"Under large over small loads: {join_named(ratios)} (each ≥ {GROWTH:g}).",
    )


def predicting_does_not(times: Mapping[str, TimesByLoad]) -> Claim:
    """Test whether all networks take the same time under small and under large loads."""
    ratios = {
        f"{BODIES[case]} ({kind})": ends.ratio
        for case, found in times.items()
        for kind, ends in found.networks.items()
    }
    return Claim(
        what="The time of a prediction is the same whatever the force.",
        holds=all(1 / GROWTH < ratio < GROWTH for ratio in ratios.values()),
        evidence=f"Under the largest over the smallest load: {join_named(ratios)} (each within a "
        f"factor of {GROWTH:g}).",
    )


@dataclass(frozen=True)
class PassTimes:
    """Times of all passes of one network, in ms.

    Attributes
    ----------
    passes : int
        Number of passes; for an ensemble, of all members.
    kept : float
        Time with weights kept from the prediction before.
    anew : float
        Time with weights drawn for every prediction.
    """

    passes: int
    kept: float
    anew: float

    def by_weights(self) -> dict[str, float]:
        """Both times; keys: "kept" and "drawn anew"."""
        return {"kept": self.kept, "drawn anew": self.anew}


def pass_table(times: Mapping[str, PassTimes], passes: int, device: str) -> Table:
    """Table of the times by case, beside the paper's.

    Parameters
    ----------
    times : mapping of str to PassTimes
        Times by case.
    passes : int
        Number of passes of one network.
    device : str
        Description of the device.
    """
    rows: list[tuple[Cell, ...]] = []
    for case, found in times.items():
        rows += [
            (BODIES[case], f"weights {how}", found.passes, ms, ms / found.passes, device)
            for how, ms in found.by_weights().items()
        ]
    paper = PAPER.bayesian_prediction
    one_pass = paper.all_passes_ms / paper.passes
    rows.append(("both", "paper", paper.passes, paper.all_passes_ms, one_pass, PAPER_DEVICE))
    return Table(
        caption=f"Time of one Bayesian prediction, {passes} passes of every U-Net of an ensemble: "
        "with the passes' weights kept from the prediction before, as they are when one predicts "
        "load after load and they fit into memory; and with weights drawn for every prediction.",
        head=("example", "", "passes", "all passes [ms]", "one pass [ms]", "on"),
        rows=tuple(rows),
    )


def pass_comparisons(times: Mapping[str, PassTimes]) -> list[Comparison]:
    """Comparisons of both times of every case with the paper's."""
    paper = PAPER.bayesian_prediction.all_passes_ms
    return [
        compare(f"{BODIES[case]}: Bayesian prediction, weights {how}", "ms", ms, paper)
        for case, found in times.items()
        for how, ms in found.by_weights().items()
    ]


STUDY = Experiment(
    name="prediction-times",
    title="Time of a prediction",
    labels=("Tab: prediction_times",),
    question="How much faster is a prediction than a solution by finite elements, and do their "
    "times depend on the load?",
    measure=measure,
    runs=(*DETERMINISTIC.values(), *BAYESIAN.values()),
    times=True,
)
