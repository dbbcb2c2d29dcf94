"""Figure of a dataset: mesh, groups, supports, loadable nodes, and some deformed samples."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from datagen.output.nodal_samples import DatasetBody, NodalSamples, Sample
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.bodies.cables import Cable
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.drawing.drawing import Drawing
from shared_schema.common.drawing.figure_style import (
    NETWORK,
    REFERENCE,
    UNDEFORMED,
    make_figure,
    save,
    styled,
)
from shared_schema.common.drawing.mesh_drawing import make_drawing
from shared_schema.common.errors import InputError
from shared_schema.common.solution_file import require_suffix
from shared_schema.dataset_reader import DatasetReader
from shared_schema.manifest import read_manifest

Array = NDArray[np.float64]
SUFFIXES = (".png", ".svg", ".pdf")
SHOWN = 4  # number of samples, if none are named
COLUMNS, PANEL = 2, 3.1  # panels side by side, and the width of one in inches
AROUND = 0.75  # height in inches of title and labels above and below a panel
ROUNDING = 1e-12  # of the largest resultant and moment: smaller ones are rounding errors
HIGHEST = 1.2  # largest height of a panel over its width; a higher body is drawn narrower
FACE = "#fbefef"  # face colour of a deformed body
FIBRES = "#b8860b", "#2e8b57", "#7b3294", "#c51b7d"  # of the families
GROUPS = "tab:orange", "tab:green", "tab:purple", "tab:brown", "tab:pink", "tab:olive", "tab:cyan"
SEEN_THROUGH = 0.4  # opacity of groups of cells, which may lie in each other
CABLE = "#1f6f4a"
SUPPORT, REST = "black", "0.45"
CELLS = {
    "quad": "quadrilaterals",
    "triangle": "triangles",
    "tetra": "tetrahedra",
    "hexahedron": "hexahedra",
}


@checked_arguments
def plot_dataset(
    nodal: Path | str, out: Path | str, *, samples: str | Sequence[int] | None = None
) -> list[int]:
    """Draw a nodal dataset, or a body without samples.

    Parameters
    ----------
    nodal : Path or str
        Nodal dataset, or what `datagen body` writes.
    out : Path or str
        Figure to write, ending in .png, .svg or .pdf.
    samples : str or sequence of int, optional
        Sample numbers, also as text N,N,…; by default four, evenly over the order of largest
        displacement.

    Returns
    -------
    list of int
        Numbers of the samples shown; none of a body.

    Raises
    ------
    InputError
        If there is no intact nodal dataset or body, or it lacks one of the samples.
    """
    path, folder = Path(out), Path(nodal)
    require_suffix(path, SUFFIXES)
    manifest = read_manifest(folder)
    if manifest.kind == "structured" and not manifest.samples + manifest.failed:
        if samples is not None:
            raise InputError(f"--samples '{samples}': {folder} is a body, which has no samples")
        reader = DatasetReader(folder)
        save(draw(DatasetBody(reader, reader.body)), path)
        return []
    dataset = NodalSamples(folder)
    if samples is None:
        numbers = dataset.evenly_by_displacement(SHOWN)
    else:
        text = samples if isinstance(samples, str) else ",".join(map(str, samples))
        numbers = dataset.named(text)
    save(draw(dataset, [dataset[number] for number in numbers]), path)
    return numbers


@styled
def draw(dataset: DatasetBody, shown: Sequence[Sample] = ()) -> Figure:
    """Draw the mesh with marked nodes, then each sample over the undeformed mesh, to one scale."""
    figure = make_figure(COLUMNS * (PANEL + 0.5), 1.0)
    rows = -(-len(shown) // COLUMNS)
    grid = GridSpec(1 + rows, COLUMNS, figure=figure)
    first = make_drawing(figure, dataset, grid[0, 0])
    _draw_marks(first, dataset)
    drawings = [
        make_drawing(
            figure, _shape_of(dataset, sample), grid[1 + place // COLUMNS, place % COLUMNS]
        )
        for place, sample in enumerate(shown)
    ]
    for drawing, sample in zip(drawings, shown, strict=True):
        _draw_sample(drawing, dataset, sample)
    first.finish()
    extents = np.array([drawing.extent() for drawing in (first, *drawings)])
    lower, upper = extents[:, 0], extents[:, 1]
    left, right = lower[:, 0].min(), upper[:, 0].max()
    for drawing in drawings:
        bottom, top = lower[1:, 1].min(), upper[1:, 1].max()
        drawing.finish((np.array((left, bottom)), np.array((right, top))), labelled=False)
    first.axes.set_xlim(left, right)
    heights = [_height(drawing.axes) for drawing in (first, *drawings[::COLUMNS])]
    grid.set_height_ratios(heights)
    figure.set_figheight(sum(heights))
    _draw_key(figure.add_subplot(grid[0, 1]), dataset)
    return figure


def _draw_marks(drawing: Drawing, dataset: DatasetBody) -> None:
    """Draw the mesh, and mark clamped and loadable nodes."""
    x = dataset.coordinates
    size = 12 if len(x) < 500 else 2
    drawing.body(x, UNDEFORMED, "white", linewidth=_line(dataset))
    for name, color in _colours(dataset).items():
        nodes, cells = dataset.groups[name]
        if cells.any():
            part = RawMesh(x, dataset.cells[cells], dataset.cell_type)
            inner = type(drawing)(drawing.axes, part)
            inner.body(x, color, color, linewidth=_line(dataset), alpha=SEEN_THROUGH)
        else:
            drawing.markers(x[nodes], color, marker="o", s=2 * size)
    for family, color in zip(_families(dataset), FIBRES, strict=False):
        drawing.directions(family, color, linewidth=2 * _line(dataset))
    _draw_cables(drawing, dataset, x)
    drawing.markers(x[dataset.clamped], SUPPORT, marker="s", s=size)
    drawing.markers(x[dataset.loadable], NETWORK, marker="o", s=size)


def _draw_sample(drawing: Drawing, dataset: DatasetBody, sample: Sample) -> None:
    """Draw the deformed body with its forces over the undeformed mesh."""
    x = sample.coordinates + sample.displacement
    drawing.body(x, REFERENCE, FACE, linewidth=_line(dataset))
    drawing.undeformed(REST, None, linewidth=max(0.3, 0.7 * _line(dataset)))
    _draw_cables(drawing, dataset, x)
    said = drawing.forces(x, sample.force)
    largest = np.linalg.norm(sample.displacement, axis=1).max()
    title = f"sample {sample.number}: displaced by up to {largest:.3g} {dataset.units.length}"
    if not said:
        loads = int(sample.force.any(axis=1).sum())
        resultant, moment = resultant_of(sample.force, sample.coordinates)
        units = dataset.units
        title += (
            f"\n{loads} forces, resultant {resultant:.4g} {units.force}, "
            f"moment {moment:.4g} {units.force} {units.length}"
        )
    drawing.axes.set_title(title, fontsize=10)


def _shape_of(dataset: DatasetBody, sample: Sample) -> DatasetBody:
    """The body in the shape of a sample."""
    body = copy(dataset)
    body.coordinates = sample.coordinates
    return body


def _draw_cables(drawing: Drawing, dataset: DatasetBody, x: Array) -> None:
    """Draw the cables of the body with nodes at x."""
    for load in dataset.actuators.loads:
        if isinstance(load, Cable):
            drawing.line(load.places(x), CABLE)


def resultant_of(force: Array, coordinates: Array) -> tuple[float, float]:
    """Magnitudes of the resultant in N, and in N m of the moment about the mean of the nodes.

    What is a rounding error of the largest one that such forces can have is 0.

    Parameters
    ----------
    force, coordinates : array, (n_nodes, d)
        In N and m.
    """
    arms = coordinates - coordinates.mean(axis=0)
    total = np.linalg.norm(force.sum(axis=0))
    moment = np.linalg.norm(np.cross(_in_space(arms), _in_space(force)).sum(axis=0))
    sizes = np.linalg.norm(force, axis=1)
    most = np.array([sizes.sum(), sizes @ np.linalg.norm(arms, axis=1)])
    found = np.array([total, moment])
    resultant, about = np.where(found > ROUNDING * most, found, 0.0)
    return float(resultant), float(about)


def _in_space(vectors: Array) -> Array:
    """Vectors of the plane or of space, (n, d) → (n, 3)."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def _draw_key(axes: Axes, dataset: DatasetBody) -> None:
    """Draw the legend, in the place beside the mesh."""
    axes.set_axis_off()
    manifest = dataset.manifest
    samples = f"{manifest.samples} samples" if manifest.samples else "body without samples"
    title = (
        f"{manifest.name}: {samples}\n"
        f"{len(dataset.coordinates)} nodes, {len(dataset.cells)} {CELLS[dataset.cell_type]}"
    )
    size = 4.0
    handles = [
        Line2D([], [], color=SUPPORT, ls="", marker="s", ms=size, mew=0, label="clamped node"),
        Line2D([], [], color=NETWORK, ls="", marker="o", ms=size, mew=0, label="loadable node"),
    ]
    handles += [
        Line2D([], [], color=color, ls="", marker="s" if cells.any() else "o", ms=6, label=name)
        for name, color in sorted(_colours(dataset).items())
        for _, cells in [dataset.groups[name]]
    ]
    several = len(_families(dataset)) > 1
    handles += [
        Line2D([], [], color=color, lw=1.4, label=f"fibres {number}" if several else "fibres")
        for number, color in zip(range(1, 1 + len(_families(dataset))), FIBRES, strict=False)
    ]
    if any(isinstance(load, Cable) for load in dataset.actuators.loads):
        handles.append(Line2D([], [], color=CABLE, lw=1.4, label="cable"))
    if manifest.samples:
        handles += [
            Line2D([], [], color=REST, lw=0.8, ls="dashed", label="undeformed"),
            Line2D([], [], color=REFERENCE, lw=1.0, label="deformed, in equilibrium"),
        ]
    axes.legend(handles=handles, loc="center left", title=title, alignment="left")


def _colours(dataset: DatasetBody) -> dict[str, str]:
    """Colours of the groups that are drawn, those of many cells first; the whole body is none."""
    names = [name for name, (_, cells) in dataset.groups.items() if not cells.all()]
    coloured = dict(zip(names, GROUPS, strict=False))
    return dict(sorted(coloured.items(), key=lambda each: -dataset.groups[each[0]][1].sum()))


def _families(dataset: DatasetBody) -> list[Array]:
    """Directions of each family of fibres, (n_cells, d)."""
    return [] if dataset.fibres is None else list(dataset.fibres.swapaxes(0, 1))


def _line(dataset: DatasetBody) -> float:
    """Line width in points, thin enough to leave space between the lines."""
    return float(np.clip(7.0 / np.sqrt(len(dataset.cells)), 0.25, 0.7))


def _height(axes: Axes) -> float:
    """Height in inches of a panel with its title and labels."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    return PANEL * min((top - bottom) / (right - left), HIGHEST) + AROUND
