"""Meshes, forces and sizes of the datasets (Table "tab:datasets"); drawings of the bodies."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from numpy.typing import ArrayLike

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Cell, Claim, Table
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import BODIES
from experiments.paper.published_numbers import PAPER, PaperDataset
from shared_schema.common.drawing import REFERENCE, UNDEFORMED, make_drawing, make_figure, styled
from surrogate.learning.data import Geometry

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


def cells_of(dataset: PaperDataset) -> tuple[str, str, str]:
    """Cells of a row: degrees of freedom, range and size."""
    padded = dataset.padded_dofs
    points = f" ({padded})" if padded != dataset.dofs else ""
    low, high = (f"{newtons:g}".replace("-", "−") for newtons in dataset.force_range_newton)
    size = f"{dataset.training_samples} + {dataset.test_samples}"
    return f"{dataset.dofs}{points}", f"{low} to {high}", size


def agree(here: PaperDataset, paper: PaperDataset) -> bool:
    """Compare DOFs, force range, N + M and the share of the test split."""
    known, sizes = [], []
    for each in (here, paper):
        samples = each.training_samples + each.test_samples
        known.append((each.dofs, each.padded_dofs, each.force_range_newton, samples))
        sizes.append(each.test_samples / samples)
    return known[0] == known[1] and abs(sizes[0] - sizes[1]) < SHARE


def characteristics(resources: Resources, name: str) -> PaperDataset:
    """Characteristics of a dataset here, as the paper's table has them."""
    dataset = resources.structured(name)
    return PaperDataset(
        dofs=dataset.geometry.coordinates.size,
        padded_dofs=dataset.geometry.dimension * dataset.geometry.grid.mask.size,
        force_range_newton=tuple(dataset.manifest.case["load"]["range"]),
        training_samples=dataset.info.train,
        test_samples=dataset.info.test,
    )


def measure(resources: Resources) -> Findings:
    """Compare every dataset with the paper's; draw the bodies and the padded grid."""
    rows: list[tuple[Cell, ...]] = []
    claims = []
    for name, paper in PAPER.datasets.items():
        here, failed = characteristics(resources, name), resources.manifest(name).failed
        rows += [(NAMES[name], "here", *cells_of(here), failed)]
        rows += [(NAMES[name], "paper", *cells_of(paper), None)]
        claims.append(
            Claim(
                what=f"{NAMES[name]}: DOFs, force range and number of samples are the paper's.",
                holds=agree(here, paper),
                evidence="DOFs {}, {} N, {} samples; ".format(*cells_of(here))
                + "the paper: {}, {} N, {}.".format(*cells_of(paper)),
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


@styled
def draw_bodies(geometries: dict[str, Geometry]) -> Figure:
    """Draw the meshes side by side: clamped nodes black, loadable nodes red."""
    figure = make_figure(9.0, 2.6)
    lengths = [np.ptp(geometry.coordinates[:, 0]) for geometry in geometries.values()]
    grid = GridSpec(1, len(geometries), figure=figure, width_ratios=lengths)
    for place, (name, geometry) in enumerate(geometries.items()):
        drawing = make_drawing(figure, geometry, grid[0, place])
        x, size = geometry.coordinates, 12 if geometry.dimension == 2 else 2
        drawing.body(x, UNDEFORMED, "white", linewidth=0.4)
        drawing.markers(x[geometry.clamped], "black", marker="s", s=size)
        drawing.markers(x[geometry.loadable], REFERENCE, marker="o", s=size)
        drawing.finish()
        drawing.axes.set_title(name, fontsize=10)
    return figure


@styled
def draw_padding(geometry: Geometry) -> Figure:
    """Draw the numbered nodes of a plane mesh, and on its grid; circles: points without a node."""
    figure = make_figure(9.6, 3.0)
    places = GridSpec(1, 2, figure=figure, width_ratios=(2, 3))
    drawing = make_drawing(figure, geometry, places[0, 0])
    drawing.body(geometry.coordinates, UNDEFORMED, "white", linewidth=0.4)
    drawing.finish()
    axes = figure.add_subplot(places[0, 1], aspect="equal")
    grid = geometry.grid
    nx, ny = grid.shape
    axes.hlines(range(ny), 0, nx - 1, color=UNDEFORMED, linewidth=0.4, zorder=0)
    axes.vlines(range(nx), 0, ny - 1, color=UNDEFORMED, linewidth=0.4, zorder=0)
    i, j = np.nonzero(~grid.mask)
    axes.scatter(i, j, s=22, facecolor="white", edgecolor=REFERENCE, linewidth=0.8)
    for i, j in np.argwhere(grid.mask):
        number = int(grid.node_at[i, j])
        _number(axes, (i, j), number)
        _number(drawing.axes, geometry.coordinates[number], number)
    axes.set_axis_off()
    return figure


def _number(axes: Axes, place: ArrayLike, number: int) -> None:
    """Write a number on a white background at a place (x, y)."""
    x, y = np.asarray(place, dtype=float)
    background = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
    axes.text(x, y, str(number), ha="center", va="center", fontsize=6, bbox=background)


STUDY = Experiment(
    name="datasets",
    title="Datasets",
    labels=("tab:datasets", "fig: three benchmark examples schematics", "L_padding"),
    question="On which meshes, under which forces and on how many samples are networks trained?",
    measure=measure,
    datasets=(*PAPER.datasets, *OTHERS),
)
