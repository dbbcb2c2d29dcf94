"""Time of a prediction beside the finite elements' (Table "prediction_times")."""

from __future__ import annotations

from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from surrogate.hardware import hardware
from surrogate.inference.prediction import PASSES, load
from surrogate.studies.accuracy import BODIES
from surrogate.studies.pass_times import PassTimes, pass_comparisons, pass_table
from surrogate.studies.record import Claim, Comparison, compare
from surrogate.studies.speed_up import CPU, PAPER_TIMES, Times, faster, real_time, times_table
from surrogate.studies.study import Outcome, Study
from surrogate.studies.times_by_load import (
    Ends,
    TimesByLoad,
    load_table,
    predicting_does_not,
    solving_ends,
    solving_grows,
)
from surrogate.studies.timing import (
    Solutions,
    alternating_seconds,
    prediction_seconds,
    read_solutions,
)
from surrogate.studies.workshop import Workshop

MS = 1e3  # in a second
DETERMINISTIC = {case: f"{case}-det" for case in BODIES}
BAYESIAN = {case: f"{case}-vb" for case in ("beam2d", "lshape2d")}


def conduct(workshop: Workshop) -> Outcome:
    """Time predictions, and take the solver's times from the datasets."""
    solutions = {
        case: read_solutions(workshop.nodal_folder(workshop.scale.runs[run].data))
        for case, run in DETERMINISTIC.items()
    }
    here = {case: times(workshop, case, found) for case, found in solutions.items()}
    passes = {case: pass_times(workshop, run) for case, run in BAYESIAN.items()}
    by_load = {case: times_by_load(workshop, case, found) for case, found in solutions.items()}
    comparisons: list[Comparison] = []
    claims: list[Claim] = []
    for case, paper in PAPER_TIMES.items():
        name, found = BODIES[case], here[case]
        for device, ms in found.network.items():
            comparisons.append(compare(f"{name}: t_{device}", "ms", ms, paper.network[device]))
            claims.append(faster(name, device, found, paper))
        if "GPU" in found.network:
            claims.append(real_time(name, found.network["GPU"], paper.network["GPU"]))
    return Outcome(
        tables=[
            times_table(here),
            load_table(by_load),
            pass_table(passes, hardware(workshop.device)),
        ],
        comparisons=[*comparisons, *pass_comparisons(passes)],
        claims=[*claims, solving_grows(by_load), predicting_does_not(by_load)],
    )


def times(workshop: Workshop, case: str, solutions: Solutions) -> Times:
    """The row of a deterministic network, for the first test sample."""
    run = DETERMINISTIC[case]
    force = workshop.dataset_of(run).nodal_test.force[0]
    devices = {"CPU": CPU}
    if workshop.device.type == "cuda":
        devices["GPU"] = workshop.device
    network = {name: network_ms(workshop, run, force, device) for name, device in devices.items()}
    solving = MS * solutions.seconds
    return Times(float(np.median(solving)), float(solving.max()), network)


def times_by_load(workshop: Workshop, case: str, solutions: Solutions) -> TimesByLoad:
    """Times of one body for small and for large loads: deterministic on a CPU, passes kept."""
    force = workshop.dataset_of(DETERMINISTIC[case]).nodal_test.force
    order = np.argsort(np.linalg.norm(force, axis=(1, 2)))
    runs = {"D": (DETERMINISTIC[case], CPU)}
    if case in BAYESIAN:
        runs["VB"] = BAYESIAN[case], workshop.device
    networks = {}
    for kind, (run, device) in runs.items():
        surrogate = load(workshop.trained(run).folder, device.type)
        predictions = [
            partial(surrogate.predict_distribution, force[order[end]], PASSES) for end in (0, -1)
        ]
        networks[kind] = Ends(*(MS * seconds for seconds in alternating_seconds(predictions)))
    return TimesByLoad(*solving_ends(solutions), networks)


def pass_times(workshop: Workshop, run: str) -> PassTimes:
    """Both times of a Bayesian network, for the first test sample."""
    force = workshop.dataset_of(run).nodal_test.force[0]
    kept, anew = (network_ms(workshop, run, force, workshop.device, a) for a in (False, True))
    return PassTimes(PASSES * workshop.scale.config_of(run).ensemble, kept, anew)


def network_ms(
    workshop: Workshop,
    run: str,
    force: NDArray[np.float64],
    device: torch.device,
    drawn_anew: bool = False,
) -> float:
    """Time of predicting one load in ms, of all passes if the network is Bayesian."""
    surrogate = load(workshop.trained(run).folder, device.type)
    return MS * prediction_seconds(surrogate, force, PASSES, drawn_anew)


STUDY = Study(
    name="prediction-times",
    title="Time of a prediction",
    labels=("Tab: prediction_times",),
    question="How much faster is a prediction than a solution by finite elements, and do their "
    "times depend on the load?",
    conduct=conduct,
    runs=(*DETERMINISTIC.values(), *BAYESIAN.values()),
    times=True,
)
