"""Time of a prediction beside the finite elements' (Table "prediction_times")."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Claim, Comparison, compare
from experiments.framework.resources import Resources
from experiments.framework.timing import alternating_seconds
from experiments.measures.bayesian_prediction_times import (
    PassTimes,
    pass_comparisons,
    pass_table,
)
from experiments.measures.errors_on_test_split import BODIES
from experiments.measures.latency import prediction, prediction_seconds
from experiments.measures.solutions import Solutions, read_solutions
from experiments.measures.speed_up import (
    CPU,
    PAPER_TIMES,
    Times,
    faster,
    real_time,
    times_table,
)
from experiments.measures.times_by_load import (
    Ends,
    TimesByLoad,
    load_table,
    predicting_does_not,
    solving_ends,
    solving_grows,
)
from experiments.paper.published_numbers import PAPER
from surrogate import load
from surrogate.hardware import hardware

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
    kept, anew = (network_ms(resources, run, force, resources.device, a) for a in (False, True))
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
