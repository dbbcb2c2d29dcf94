"""Meshes, forces and sizes of the datasets (Table "tab:datasets"); drawings of the bodies."""

from __future__ import annotations

from dataclasses import dataclass

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Cell, Claim, Table
from experiments.framework.resources import Resources
from experiments.measures.dataset_figures import draw_bodies, draw_padding
from experiments.measures.errors_on_test_split import BODIES
from experiments.paper.published_numbers import PAPER

NAMES = {"beam2d": "2D beam", "beam2d_f1": "2D beam#"} | BODIES
OTHERS = (
    "beam2d_noisy",
    "lshape2d_noisy",
    "beam3d_gmsh",
    "beam3d_random",
    "beam2d_sweep",
    "lshape2d_sweep",
    "beam2d_multiple",
    "beam2d_away",
)
SHARE = 1e-3  # largest difference of the shares of the test split


@dataclass(frozen=True)
class Characteristics:
    """Characteristics of a dataset, as in the paper's table.

    Attributes
    ----------
    dofs, padded : int
        Degrees of freedom of the mesh, and components on its grid.
    force : tuple of float
        Range of a force component in N.
    train, test : int
        Numbers of samples N and M.
    """

    dofs: int
    padded: int
    force: tuple[float, ...]
    train: int
    test: int

    @property
    def samples(self) -> int:
        """Number of all samples N + M."""
        return self.train + self.test

    def cells(self) -> tuple[str, str, str]:
        """Cells of the row: degrees of freedom, range and size."""
        padded = f" ({self.padded})" if self.padded != self.dofs else ""
        low, high = (f"{newtons:g}".replace("-", "−") for newtons in self.force)
        return f"{self.dofs}{padded}", f"{low} to {high}", f"{self.train} + {self.test}"

    def agrees(self, other: Characteristics) -> bool:
        """Compare DOFs, force range, N + M and the share of the test split."""
        shares = (self.test / self.samples, other.test / other.samples)
        return (
            (self.dofs, self.padded, self.force) == (other.dofs, other.padded, other.force)
            and self.samples == other.samples
            and abs(shares[0] - shares[1]) < SHARE
        )


PAPER_DATASETS = {
    name: Characteristics(
        paper.dofs,
        paper.padded_dofs,
        paper.force_range_newton,
        paper.training_samples,
        paper.test_samples,
    )
    for name, paper in PAPER.datasets.items()
}


def characteristics(resources: Resources, name: str) -> Characteristics:
    """Characteristics of a dataset here."""
    dataset = resources.structured(name)
    return Characteristics(
        dataset.geometry.coordinates.size,
        dataset.geometry.dimension * dataset.geometry.grid.mask.size,
        tuple(dataset.manifest.case["load"]["range"]),
        dataset.info.train,
        dataset.info.test,
    )


def measure(resources: Resources) -> Findings:
    """Compare every dataset with the paper's; draw the bodies and the padded grid."""
    rows: list[tuple[Cell, ...]] = []
    claims = []
    for name, paper in PAPER_DATASETS.items():
        here, failed = characteristics(resources, name), resources.manifest(name).failed
        rows += [(NAMES[name], "here", *here.cells(), failed)]
        rows += [(NAMES[name], "paper", *paper.cells(), None)]
        claims.append(
            Claim(
                what=f"{NAMES[name]}: DOFs, force range and number of samples are the paper's.",
                holds=here.agrees(paper),
                evidence="DOFs {}, {} N, {} samples; ".format(*here.cells())
                + "the paper: {}, {} N, {}.".format(*paper.cells()),
            )
        )
    head = ("dataset", "", "DOFs (padded)", "force component [N]", "N + M", "failed load cases")
    caption = "Datasets to train on. In brackets: components on the zero-padded grid."
    return Findings(
        tables=[Table(caption=caption, head=head, rows=tuple(rows)), table_of_others(resources)],
        claims=claims,
        figures={
            "bodies": (
                draw_bodies({BODIES[name]: resources.structured(name).geometry for name in BODIES}),
                "The three bodies: meshes, clamped nodes (black), and the nodes one of which a "
                "training sample loads (red).",
            ),
            "padding": (
                draw_padding(resources.structured("lshape2d").geometry),
                "The L-shape's numbered nodes in its mesh (left) and on the network's grid "
                "(right); at points without a node (circles) forces and displacements are zero.",
            ),
        },
    )


def table_of_others(resources: Resources) -> Table:
    """Table of the datasets that are not in the paper's table."""
    rows = []
    for name in OTHERS:
        spec, manifest = resources.scale.datasets[name], resources.manifest(name)
        change = "displacements with noise" if spec.noise else f"{spec.order} order of nodes"
        origin = f"{spec.of}, {change}" if spec.of else spec.case
        rows.append((name, origin, manifest.samples, manifest.failed))
    return Table(
        caption="Datasets for noise, node orders and loads outside the training's.",
        head=("dataset", "case or origin", "samples", "failed load cases"),
        rows=tuple(rows),
    )


STUDY = Experiment(
    name="datasets",
    title="Datasets",
    labels=("tab:datasets", "fig: three benchmark examples schematics", "L_padding"),
    question="On which meshes, under which forces and on how many samples are networks trained?",
    measure=measure,
    datasets=(*PAPER_DATASETS, *OTHERS),
)
