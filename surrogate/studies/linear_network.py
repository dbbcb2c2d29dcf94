"""One dense layer that starts at K⁻¹, beside the U-Net (Table "CNN_MLP")."""

from __future__ import annotations

import math
from dataclasses import dataclass

from surrogate.studies.accuracy import BODIES, MM, test_errors
from surrogate.studies.record import Cell, Claim, Comparison, Table, compare
from surrogate.studies.study import Outcome, Study
from surrogate.studies.workshop import Workshop

LINEAR = "*-linear"
ORDER_OF_SIZE = math.sqrt(10)  # a ratio from here on is nearer to 10 than to 1, in decades


@dataclass(frozen=True)
class Network:
    """A row of the table.

    Attributes
    ----------
    millions : float
        Of trainable parameters.
    mean, std : float
        ē and σ(e) in mm.
    """

    millions: float
    mean: float
    std: float

    def cells(self) -> tuple[Cell, ...]:
        """As the table has them."""
        return self.millions, self.mean, self.std


PAPER_CASE = "beam3d"
PAPER_UNET, PAPER_LINEAR = Network(94.1, 0.6, 0.3), Network(146.3, 7.0, 8.0)


def network(workshop: Workshop, run: str) -> Network:
    """The row of a run."""
    errors = test_errors(workshop, run)
    parameters = workshop.run_record(run).parameters
    return Network(parameters / 1e6, MM * errors.mean_error, MM * errors.std_error)


def conduct(workshop: Workshop) -> Outcome:
    """Measure every linear network of the scale, and the U-Net on the same samples."""
    rows: list[tuple[Cell, ...]] = []
    claims: list[Claim] = []
    comparisons: list[Comparison] = []
    for run in workshop.scale.matching((LINEAR,)):
        case = workshop.case_of(run)
        linear = network(workshop, run)
        unet = network(workshop, f"{workshop.scale.runs[run].data}-det")
        rows += [(BODIES[case], "U-Net", *unet.cells()), (BODIES[case], "linear", *linear.cells())]
        claims.append(worse(BODIES[case], linear, unet))
        if case == PAPER_CASE:
            rows += [
                (BODIES[case], "U-Net, paper", *PAPER_UNET.cells()),
                (BODIES[case], "linear, paper", *PAPER_LINEAR.cells()),
            ]
            comparisons += [
                compare("linear network: ē", "mm", linear.mean, PAPER_LINEAR.mean),
                compare("linear network: σ(e)", "mm", linear.std, PAPER_LINEAR.std),
            ]
            claims.append(larger(linear, unet))
    caption = "One dense layer, trained from K⁻¹ on, beside the deterministic U-Net."
    head = ("example", "network", "parameters [M]", "ē [mm]", "σ(e) [mm]")
    return Outcome([Table(caption=caption, head=head, rows=tuple(rows))], comparisons, claims)


def worse(body: str, linear: Network, unet: Network) -> Claim:
    """Whether the linear network errs more by an order of size."""
    ratio, paper = linear.mean / unet.mean, PAPER_LINEAR.mean / PAPER_UNET.mean
    return Claim(
        what=f"{body}: the linear network's error is larger than the U-Net's by an order of size.",
        holds=ratio >= ORDER_OF_SIZE,
        evidence=f"{linear.mean:.3g} and {unet.mean:.3g} mm, {ratio:.3g} times (from "
        f"{ORDER_OF_SIZE:.2g} times on it holds); the paper, of the 3D beam: {paper:.3g} times.",
    )


def larger(linear: Network, unet: Network) -> Claim:
    """Whether the linear network has more parameters."""
    return Claim(
        what="3D beam: the linear network has more parameters than the U-Net.",
        holds=linear.millions > unet.millions,
        evidence=f"{linear.millions:.3g} and {unet.millions:.3g} million; the paper: "
        f"{PAPER_LINEAR.millions} and {PAPER_UNET.millions} million.",
    )


STUDY = Study(
    name="linear-network",
    title="U-Net and linear network",
    labels=("CNN_MLP",),
    question="How much of the response does the best linear map from forces to displacements miss?",
    conduct=conduct,
    runs=(LINEAR, *(f"{case}-det" for case in BODIES)),
)
