"""One dense layer that starts at K⁻¹, beside the U-Net (Table "CNN_MLP")."""

from __future__ import annotations

import math
from dataclasses import dataclass

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Cell, Claim, Comparison, Table, compare
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import BODIES, MM, split_errors
from experiments.paper.published_numbers import PAPER

LINEAR = "*-linear"
ORDER_OF_MAGNITUDE = math.sqrt(10)  # larger ratios are nearer to 10 than to 1, in decades


@dataclass(frozen=True)
class Network:
    """A row of the table.

    Attributes
    ----------
    millions : float
        Number of trainable parameters, in millions.
    mean, std : float
        Errors ē and σ(e) in mm.
    """

    millions: float
    mean: float
    std: float

    def cells(self) -> tuple[Cell, ...]:
        """Cells of the row."""
        return self.millions, self.mean, self.std


PAPER_CASE = PAPER.linear_network.case
PAPER_DOFS = PAPER.datasets[PAPER_CASE].dofs  # the paper's linear network has dofs² weights
PAPER_LINEAR = Network(
    PAPER_DOFS**2 / 1e6, PAPER.linear_network.mean_error_mm, PAPER.linear_network.std_error_mm
)
UNET = PAPER.networks[PAPER_CASE]["deterministic"]
PAPER_UNET = Network(UNET.parameters / 1e6, UNET.mean_error_mm, UNET.std_error_mm)


def measure_network(resources: Resources, run: str) -> Network:
    """Measure the row of a run."""
    errors = split_errors(resources, run)
    parameters = resources.run_record(run).parameters
    return Network(parameters / 1e6, MM * errors.mean_error, MM * errors.std_error)


def measure(resources: Resources) -> Findings:
    """Measure every linear network of the scale, and the U-Net on the same samples."""
    rows: list[tuple[Cell, ...]] = []
    claims: list[Claim] = []
    comparisons: list[Comparison] = []
    for run in resources.scale.matching((LINEAR,)):
        case = resources.case_of(run)
        linear = measure_network(resources, run)
        unet = measure_network(resources, f"{resources.scale.runs[run].data}-det")
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
    caption = (
        "One dense layer, trained from K⁻¹ on, beside the deterministic U-Net. The layer has a "
        "weight for every pair of free degrees of freedom; the paper's has the clamped ones as "
        f"well, {PAPER_DOFS}² weights."
    )
    head = ("example", "network", "parameters [M]", "ē [mm]", "σ(e) [mm]")
    return Findings([Table(caption=caption, head=head, rows=tuple(rows))], comparisons, claims)


def worse(body: str, linear: Network, unet: Network) -> Claim:
    """Test whether the error of the linear network is larger by an order of magnitude."""
    ratio, paper = linear.mean / unet.mean, PAPER_LINEAR.mean / PAPER_UNET.mean
    return Claim(
        what=f"{body}: the linear network's error is larger than the U-Net's by an order of "
        "magnitude.",
        holds=ratio >= ORDER_OF_MAGNITUDE,
        evidence=f"ē = {linear.mean:.3g} and {unet.mean:.3g} mm, {ratio:.3g} times (nearer to 10 "
        f"than to 1 on a logarithmic scale: ≥ {ORDER_OF_MAGNITUDE:.2g}); the paper, of the 3D "
        f"beam: {paper:.3g} times.",
    )


STUDY = Experiment(
    name="linear-network",
    title="U-Net and linear network",
    labels=("CNN_MLP",),
    question="How much of the response does the best linear map from forces to displacements miss?",
    measure=measure,
    runs=(LINEAR, *(f"{case}-det" for case in BODIES)),
)
