"""The same number of channels at every level of the U-Net (Table "const_channel")."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

from surrogate.hardware import hardware
from surrogate.prediction import load
from surrogate.studies.accuracy import MM, test_errors
from surrogate.studies.record import Cell, Claim, Table, compare
from surrogate.studies.study import Outcome, Study
from surrogate.studies.timing import prediction_seconds
from surrogate.studies.workshop import Workshop

RUNS = "beam3d-c*"
BEST, TOO_MANY = 64, 128  # of the paper


@dataclass(frozen=True)
class Network:
    """A row of the table.

    Attributes
    ----------
    mean, std : float
        ē and σ(e) in mm.
    minutes : float
        Of training.
    prediction : float
        Time in ms.
    """

    mean: float
    std: float
    minutes: float
    prediction: float

    def cells(self) -> tuple[Cell, ...]:
        """As the table has them."""
        return self.mean, self.std, self.minutes, self.prediction


PAPER = {  # on one V100
    16: Network(1.6, 0.9, 272, 6),
    32: Network(1.1, 0.7, 293, 6.5),
    64: Network(0.8, 0.5, 348, 7.5),
    128: Network(3.5, 3.3, 646, 9),
}


def network(workshop: Workshop, run: str) -> Network:
    """The row of a run."""
    errors, trained = test_errors(workshop, run), workshop.trained(run)
    surrogate = load(trained.folder, workshop.device.type)
    seconds = prediction_seconds(surrogate, workshop.dataset_of(run).nodal_test.force[0])
    minutes = workshop.run_record(run).minutes
    return Network(MM * errors.mean_error, MM * errors.std_error, minutes, 1e3 * seconds)


def conduct(workshop: Workshop) -> Outcome:
    """Measure errors and times of all runs of the scale."""
    scale = workshop.scale
    runs = {scale.config_of(run).network.channels: run for run in scale.matching((RUNS,))}
    found = {channels: network(workshop, runs[channels]) for channels in sorted(runs)}
    rows: list[tuple[Cell, ...]] = []
    comparisons = []
    for channels, here in found.items():
        rows.append((channels, "here", *here.cells()))
        if channels in PAPER:
            paper = PAPER[channels]
            rows.append((channels, "paper", *paper.cells()))
            comparisons += [
                compare(f"c = {channels}: ē", "mm", here.mean, paper.mean),
                compare(f"c = {channels}: σ(e)", "mm", here.std, paper.std),
            ]
    head = ("channels c", "", "ē [mm]", "σ(e) [mm]", "training [min]", "prediction [ms]")
    table = Table(
        caption="3D beam, deterministic U-Nets with c channels at every level; predictions here "
        f"on {hardware(workshop.device)}, in the paper on one V100.",
        head=head,
        rows=tuple(rows),
    )
    return Outcome([table], comparisons, claims_on({c: here.mean for c, here in found.items()}))


def claims_on(means: Mapping[int, float]) -> list[Claim]:
    """The paper's claims on ē in mm, by number of channels, ascending."""
    up_to_best = [mean for channels, mean in means.items() if channels <= BEST]
    numbers = ", ".join(f"{mean:.3g} mm of c = {channels}" for channels, mean in means.items())
    papers = ", ".join(f"{paper.mean} mm of c = {channels}" for channels, paper in PAPER.items())
    missing = "" if TOO_MANY in means else f"; c = {TOO_MANY} was not run"
    claims = [
        Claim(
            what=f"More channels make a smaller error, up to c = {BEST}.",
            holds=all(fewer > more for fewer, more in pairwise(up_to_best)),
            evidence=f"ē is {numbers}{missing}; the paper: {papers}.",
        )
    ]
    if TOO_MANY in means and BEST in means:
        claims.append(
            Claim(
                what=f"c = {TOO_MANY} is worse than c = {BEST}: it overfits.",
                holds=means[TOO_MANY] > means[BEST],
                evidence=f"ē is {means[TOO_MANY]:.3g} and {means[BEST]:.3g} mm; the paper: "
                f"{PAPER[TOO_MANY].mean} and {PAPER[BEST].mean} mm.",
                better=True,
            )
        )
    return claims


STUDY = Study(
    name="constant-channels",
    title="Number of channels",
    labels=("const_channel",),
    question="How many channels are enough, if every level of the U-Net has the same?",
    conduct=conduct,
    runs=(RUNS,),
    times=True,
)
