"""Meshes, forces and sizes of the datasets (Table "tab:datasets"), and the three bodies."""

from __future__ import annotations

from dataclasses import dataclass

from surrogate.evaluation.paper import PAPER
from surrogate.studies.accuracy import BODIES
from surrogate.studies.bodies import draw_bodies
from surrogate.studies.padding import draw_padding
from surrogate.studies.record import Cell, Claim, Table
from surrogate.studies.study import Outcome, Study
from surrogate.studies.workshop import Workshop

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
SHARE = 1e-3  # by which the test split's part of the samples may differ


@dataclass(frozen=True)
class Characteristics:
    """What the paper's table says of a dataset.

    Attributes
    ----------
    dofs, padded : int
        Degrees of freedom of the mesh, and components on its grid.
    force : tuple of float
        Range of a force component in N.
    train, test : int
        N and M.
    """

    dofs: int
    padded: int
    force: tuple[float, ...]
    train: int
    test: int

    @property
    def samples(self) -> int:
        """N + M."""
        return self.train + self.test

    def cells(self) -> tuple[str, str, str]:
        """Degrees of freedom, range and size, as the table has them."""
        padded = f" ({self.padded})" if self.padded != self.dofs else ""
        low, high = (f"{newtons:g}".replace("-", "−") for newtons in self.force)
        return f"{self.dofs}{padded}", f"{low} to {high}", f"{self.train} + {self.test}"

    def agrees(self, other: Characteristics) -> bool:
        """Whether DOFs, force range, N + M and the test split's share of it are the same."""
        parts = (self.test / self.samples, other.test / other.samples)
        return (
            (self.dofs, self.padded, self.force) == (other.dofs, other.padded, other.force)
            and self.samples == other.samples
            and abs(parts[0] - parts[1]) < SHARE
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


def characteristics(workshop: Workshop, name: str) -> Characteristics:
    """The same of a dataset here."""
    dataset = workshop.structured(name)
    return Characteristics(
        dataset.geometry.coordinates.size,
        dataset.geometry.dimension * dataset.geometry.grid.mask.size,
        tuple(dataset.manifest.case["load"]["range"]),
        dataset.info.train,
        dataset.info.test,
    )


def conduct(workshop: Workshop) -> Outcome:
    """Put every dataset beside the paper's; draw the bodies."""
    rows: list[tuple[Cell, ...]] = []
    claims = []
    for name, paper in PAPER_DATASETS.items():
        here, failed = characteristics(workshop, name), workshop.manifest(name).failed
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
    return Outcome(
        tables=[Table(caption=caption, head=head, rows=tuple(rows)), table_of_others(workshop)],
        claims=claims,
        figures={
            "bodies": (
                draw_bodies({BODIES[name]: workshop.structured(name).geometry for name in BODIES}),
                "The three bodies: meshes, clamped nodes (black), and the nodes one of which a "
                "training sample loads (red).",
            ),
            "padding": (
                draw_padding(workshop.structured("lshape2d").geometry),
                "The L-shape's numbered nodes in its mesh (left) and on the network's grid "
                "(right); at points without a node (circles) forces and displacements are zero.",
            ),
        },
    )


def table_of_others(workshop: Workshop) -> Table:
    """The datasets that the paper's table does not have."""
    rows = []
    for name in OTHERS:
        spec, manifest = workshop.scale.datasets[name], workshop.manifest(name)
        change = "displacements with noise" if spec.noise else f"{spec.order} order of nodes"
        origin = f"{spec.of}, {change}" if spec.of else spec.case
        rows.append((name, origin, manifest.samples, manifest.failed))
    return Table(
        caption="Datasets for noise, node orders and loads outside the training's.",
        head=("dataset", "case or origin", "samples", "failed load cases"),
        rows=tuple(rows),
    )


STUDY = Study(
    name="datasets",
    title="Datasets",
    labels=("tab:datasets", "fig: three benchmark examples schematics", "L_padding"),
    question="On which meshes, under which forces and on how many samples are networks trained?",
    conduct=conduct,
    datasets=(*PAPER_DATASETS, *OTHERS),
)
