"""Speed-up of predictions by deterministic networks over solutions by finite elements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch

from experiments.framework.record import Cell, Claim, Table
from experiments.measures.errors_on_test_split import BODIES
from experiments.paper.published_numbers import PAPER
from surrogate.hardware import hardware

FASTER = {"CPU": 10, "GPU": 100}  # smallest speed-ups that agree with the paper's ratios
CPU = torch.device("cpu")


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
