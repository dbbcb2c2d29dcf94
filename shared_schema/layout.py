"""Layout of a shard: one annotated tree for each kind of dataset, for stiffness and load cases.

Axes are named: ``sample``, ``node``, ``dim`` (space dimension d), ``cell``, ``corner`` (of a cell),
``load`` (loaded nodes of a sample, padded), ``failed``; ``*grid`` stands for nx, ny[, nz];
``source`` (nodes that a grid point's value is made of), ``target`` (grid points for a node's),
``entry``, ``pointer`` (of a sparse matrix); ``group`` (of nodes), ``facet``, ``facet_corner`` and
``surface`` (of the body's surface under pressure); ``parameter``, ``end`` (of its range), ``term``
(of a family of shapes); ``family`` (of fibres); ``pose`` (centre and
radius of a ball); ``between`` (points of quadratic elements between the nodes, in the order of
`shared_schema.common.bodies.points_between`); ``actuator`` (of the case, in the order of their
names); ``frame`` (of a motion).
An axis has the same length wherever it appears in one shard, and all axes but ``sample``,
``failed`` have the same length in every shard of a dataset.
"""

from __future__ import annotations

import re
from collections.abc import Container
from dataclasses import dataclass
from typing import Any, Literal

from numpy.typing import NDArray

SCHEMA_VERSION = 1
NO_NODE = -1  # in place of a node number: padding of loaded nodes, a grid point without value

Kind = Literal["nodal", "structured"]  # of datasets
FileKind = Literal["nodal", "structured", "stiffness", "loads"]
Arrays = dict[str, NDArray[Any]]  # of a shard, by path


@dataclass(frozen=True)
class ArrayLayout:
    """One HDF5 dataset of a shard.

    Attributes
    ----------
    path : str
        Path in the file.
    dtype : str
        NumPy name of its type; ``str`` for UTF-8 text.
    axes : tuple of str
        Named axes, slowest first.
    units : str
        SI unit, or ``1``.
    description : str
    sparse : bool
        True if most values are zero; such a dataset is stored compressed.
    optional : bool
        True if a shard may lack it.
    """

    path: str
    dtype: str
    axes: tuple[str, ...]
    units: str
    description: str
    sparse: bool = False
    optional: bool = False


ENTRY = re.compile(r"(\S+) : (\w+) \((.*?)\) (\S+?)(, sparse)?(, optional)? — (.*)")


def _tree(text: str) -> tuple[ArrayLayout, ...]:
    """Read lines ``path : type (axes) unit[, sparse][, optional] — description``.

    Lines that go on with a description are indented.
    """
    lines = re.sub(r"\n +", " ", text.strip()).splitlines()
    found = [ENTRY.fullmatch(line) for line in lines]
    assert all(found), text
    return tuple(
        ArrayLayout(path, dtype, tuple(axes.split(", ")), units, said, bool(sparse), bool(optional))
        for path, dtype, axes, units, sparse, optional, said in (m.groups() for m in found if m)
    )


def _between(group: str, axis: str) -> str:
    """Forces between the nodes, of the load cases of a group along an axis."""
    return f"""\
{group}/force_between : float64 ({axis}, between, dim) N, sparse, optional — part of a distributed
    load that acts on the points of quadratic elements between the nodes; `force` is at the nodes
    and does the work of all, in displacements that are linear in the cells"""


STABLE = """\
samples/stable : bool (sample) 1, optional — the equilibrium is stable: its tangent is positive
    definite"""
PARAMETERS = """\
samples/parameters : float64 (sample, parameter) 1, optional — parameters of each sample's shape"""
ACTUATION = """\
samples/actuation : float64 (sample, actuator) 1, optional — what is given of each actuator, in the
    order of their names: N of a tension, m of a length, Pa of a pressure or gas, m³ of a volume
samples/amplitude : float64 (sample, actuator) 1, optional — tensions in N and pressures in Pa;
    `force` includes their forces on the undeformed body
samples/quantity : float64 (sample, actuator) 1, optional — lengths in m and volumes in m³"""
FRAMES = """\
frames/time : float64 (frame) s, optional — times of the frames, if the samples are motions;
    `displacement` is then that at the end
samples/frame_displacement : float64 (sample, frame, node, dim) m, optional — displacement of every
    node in each frame
samples/frame_velocity : float64 (sample, frame, node, dim) m/s, optional — its velocity
samples/frame_factor : float64 (sample, frame) 1, optional — part of the load that acts"""
SPLIT = """\
samples/number : int64 (sample) 1 — sample number
samples/is_test : bool (sample) 1 — belongs to the test split"""
MESH = _tree("""
mesh/coordinates : float64 (node, dim) m — node positions of the undeformed body
mesh/cells : int64 (cell, corner) 1 — node numbers of every cell, VTK order
mesh/clamped : bool (node) 1 — nodes whose displacement is prescribed as zero
mesh/loadable : bool (node) 1 — nodes that the load family may load
mesh/held : bool (node, dim) 1, optional — components of displacement prescribed as zero, if not all
    or none of a node's are
mesh/material : int64 (cell) 1, optional — position of each cell's material in the case, if it has
    several
mesh/fibres : float64 (cell, family, dim) 1, optional — unit vectors of the families of fibres in
    the undeformed body, if a material has some; 0 where a cell's material has fewer
mesh/group_names : str (group) 1, optional — names of the groups
mesh/groups : bool (group, node) 1, optional — nodes of the mesh's groups
mesh/group_facets : bool (group, side) 1, optional — facets of the groups, of those of the surface
    in the lexicographic order of their nodes, ascending; without it all whose nodes belong
mesh/group_cells : bool (group, cell) 1, optional — cells of the groups; without it all whose nodes
    belong
mesh/parameter_names : str (parameter) 1, optional — names of the parameters of a family of shapes
mesh/parameter_ranges : float64 (parameter, end) 1, optional — lowest and highest value of each
mesh/shape_terms : float64 (term, node, dim) m, optional — node positions as a quadratic polynomial
    of the parameters (`shared_schema.common.bodies.shape_family`); the first are `coordinates`
mesh/pressed : int64 (facet, facet_corner) 1, optional — facets under a pressure that follows the
    surface, seen from outside
mesh/pressed_surface : int64 (facet) 1, optional — number of the surface that each of them belongs
    to
""")
NODAL = MESH + _tree(f"""
samples/number : int64 (sample) 1 — sample number
samples/loaded_nodes : int64 (sample, load) 1, sparse — loaded nodes, padded with -1
samples/force : float64 (sample, load, dim) N, sparse — force vector at each loaded node, padded
    with 0
{_between("samples", "sample")}
samples/displacement : float64 (sample, node, dim) m — displacement of every node in equilibrium
samples/converged_reason : int64 (sample) 1 — SNESConvergedReason of PETSc
samples/load_steps : int64 (sample) 1 — converged load steps
samples/cutbacks : int64 (sample) 1 — failed load steps, cut back
samples/newton_iterations : int64 (sample) 1 — Newton iterations of all load steps
samples/residual_norm : float64 (sample) N — 2-norm of the last residual
samples/wall_time : float64 (sample) s — time that the solve took
{FRAMES}
samples/pressure : float64 (sample, surface) Pa, optional — pressure on each surface; `force`
    includes its forces on the undeformed body
samples/tool : float64 (sample, pose) m, optional — centre and radius of the rigid ball that pushes
    the body; `force` includes its forces
samples/penetration : float64 (sample) m, optional — largest depth of a node inside the ball
{ACTUATION}
{STABLE}
{PARAMETERS}
samples/coordinates : float64 (sample, node, dim) m, optional — node positions of the undeformed
    body of each sample, if they are not those of all
failed/number : int64 (failed) 1 — sample number of unsolved load cases
failed/loaded_nodes : int64 (failed, load) 1 — loaded nodes, padded with -1
failed/force : float64 (failed, load, dim) N — force vectors, padded with 0
{_between("failed", "failed")}
failed/load_factor : float64 (failed) 1 — part of the load under which an equilibrium was still
    found
failed/reason : str (failed) 1 — why the load case was given up
failed/pressure : float64 (failed, surface) Pa, optional — pressure on each surface
failed/parameters : float64 (failed, parameter) 1, optional — parameters of each load case's shape
failed/actuation : float64 (failed, actuator) 1, optional — what is given of each actuator
""")
STRUCTURED = MESH + _tree(f"""
grid/node_at : int64 (*grid) 1 — node number at each grid point, -1 where the grid has no node
grid/mask : bool (*grid) 1 — grid points that are nodes
{SPLIT}
samples/force : float32 (sample, dim, *grid) N, sparse — nodal force, channels first, 0 where the
    grid has no node
samples/displacement : float32 (sample, dim, *grid) m — nodal displacement, channels first, 0 where
    the grid has no node
{_between("samples", "sample")}
{ACTUATION}
{STABLE}
{PARAMETERS}
""")
EMBEDDED = MESH + _tree(f"""
grid/sources : int64 (*grid, source) 1 — nodes that the value at each grid point is made of, -1
    where the grid has no value
grid/source_weights : float64 (*grid, source) 1 — their weights
grid/points : int64 (node, target) 1 — grid points, counted x slowest, that the value at each node
    is made of
grid/point_weights : float64 (node, target) 1 — their weights
grid/mask : bool (*grid) 1 — grid points that have a value
{SPLIT}
samples/force : float32 (sample, dim, *grid) N, sparse — forces on the grid that do the work of the
    nodal ones, channels first
samples/displacement : float32 (sample, dim, *grid) m — interpolated displacement, channels first, 0
    where the grid has no value
samples/loaded_nodes : int64 (sample, load) 1, sparse — loaded nodes, padded with -1
samples/nodal_force : float32 (sample, load, dim) N, sparse — force vector at each loaded node,
    padded with 0
samples/nodal_displacement : float32 (sample, node, dim) m — displacement of every node in
    equilibrium
{_between("samples", "sample")}
{ACTUATION}
{STABLE}
{PARAMETERS}
""")
STIFFNESS = _tree("""
stiffness/data : float64 (entry) N/m — entries of the stiffness of the undeformed body, no supports
    applied, row by row; degree of freedom node * d + component
stiffness/indices : int64 (entry) 1 — column of each entry
stiffness/indptr : int64 (pointer) 1 — where each row begins, and the last ends
""")
LOADS = MESH[:1] + _tree(f"""
loads/loaded_nodes : int64 (sample, load) 1 — loaded nodes of every load case, padded with -1
loads/force : float64 (sample, load, dim) N — force vector at each loaded node, padded with 0
{_between("loads", "sample")}
""")

LAYOUTS: dict[FileKind, tuple[ArrayLayout, ...]] = {
    "nodal": NODAL,
    "structured": STRUCTURED,
    "stiffness": STIFFNESS,
    "loads": LOADS,
}
SHARD_ATTRIBUTES = ("schema_version", "kind", "case_digest", "cell_type")


def layout_for(kind: FileKind, paths: Container[str]) -> tuple[ArrayLayout, ...]:
    """Layout of a shard that has datasets at some paths.

    A structured shard that has ``grid/sources`` has a grid embedded on a mesh without a structured
    order, and with it the nodal samples, which such a grid does not hold exactly.
    """
    if kind == "structured" and "grid/sources" in paths:
        return EMBEDDED
    return LAYOUTS[kind]


def shape_problem(
    layout: ArrayLayout, shape: tuple[int, ...], lengths: dict[str, tuple[int, ...]]
) -> str | None:
    """Check a shape against the named axes of its layout.

    Parameters
    ----------
    layout : ArrayLayout
    shape : tuple of int
        Shape of the array.
    lengths : dict
        Length of every axis seen so far (``*grid`` has several); new axes are added.

    Returns
    -------
    str or None
        Description of the problem, if there is one.
    """
    grid_rank = len(shape) - (len(layout.axes) - 1) if "*grid" in layout.axes else 0
    fits = grid_rank in (2, 3) if "*grid" in layout.axes else len(shape) == len(layout.axes)
    if not fits:
        return f"has shape {shape}, expected axes ({', '.join(layout.axes)})"
    start = 0
    for axis in layout.axes:
        width = grid_rank if axis == "*grid" else 1
        length = shape[start : start + width]
        start += width
        expected = lengths.setdefault(axis, length)
        if length != expected:
            return f"has shape {shape}: axis '{axis}' is {length}, expected {expected}"
    return None
