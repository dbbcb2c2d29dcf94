"""One load case: solved, kept with all that is known of it, written to a file, drawn."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from datagen.cases.body import Body
from datagen.cases.case import CaseSource, read_case
from datagen.loaded_case import LoadedCase, Pushing, loaded_case
from datagen.mesh.distributed_mesh import Mesh
from datagen.output.cell_stresses import CellStresses, reactions_of_supports
from datagen.solver.following_loads import found_actuation
from datagen.solver.load_stepping import read_start, solve_from, solve_load_case
from datagen.solver.tool_contact import INSIDE
from datagen.stability import with_stability
from shared_schema.actuators import Actuated
from shared_schema.common.arguments import checked_arguments, real_numbers, require_type
from shared_schema.common.bodies.command_loads import (
    Loads,
)
from shared_schema.common.bodies.equilibrium import size_warning
from shared_schema.common.errors import InputError, WorkError
from shared_schema.common.progress import LoadProgress
from shared_schema.common.solution_file import write_solution
from shared_schema.common.units import SI, Units
from shared_schema.materials import Volumetric
from shared_schema.samples.results import SolveReport
from shared_schema.tools import Contact, Tool

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)


@dataclass(frozen=True, repr=False, kw_only=True)
class Solution:
    """Equilibrium of a body under one load case.

    Attributes
    ----------
    case : str
        Name of the case.
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
        Node numbers, VTK order.
    cell_type : str
        meshio's name.
    force : array, (n_nodes, d)
        Nodal forces in N, with those of pressures on the undeformed body, of held nodes and of a
        tool.
    force_between : array, (n_between, d), or None
        The part of distributed forces that acts between the nodes of quadratic elements, in N
        (`shared_schema.common.bodies.points_between`); None if there is none.
    displacement : array, (n_nodes, d)
        In m.
    reactions : array, (n_nodes, d)
        Forces of the supports on the body in N, 0 elsewhere.
    stresses : mapping of str to array, (n_cells, …)
        Stresses and strain energy of the cells (`shared_schema.common.bodies.equilibrium`);
        empty unless they were asked for.
    contact : Contact or None
        Forces of a tool, and how deep nodes are inside it.
    actuators : mapping of str to Actuated
        Tension and length of each cable, pressure and volume of each chamber.
    report : SolveReport
        Converged reason, load steps, Newton iterations and residual.
    tolerance : float
        On the norm of the residual, in N.
    origin : str
        Where Newton's method began: ``""`` without a given start, ``start``, or ``rest`` if the
        start did not lead to the equilibrium.
    unknowns : int
        Number of unknowns.
    linear_solver : str
        Its name.
    seconds : float
        Time of the solve.
    notes : tuple of str
        Which nodes loads were moved to (`nearest`).
    units : Units
        Labels of all numbers, for messages and figures.
    """

    case: str
    coordinates: Array
    cells: NDArray[np.int64]
    cell_type: str
    force: Array
    force_between: Array | None
    displacement: Array
    reactions: Array
    stresses: Mapping[str, Array]
    contact: Contact | None
    actuators: Mapping[str, Actuated]
    report: SolveReport
    tolerance: float
    origin: str
    unknowns: int
    linear_solver: str
    seconds: float
    notes: tuple[str, ...]
    units: Units = SI

    @property
    def largest_displacement(self) -> float:
        """Largest displacement of a node in m."""
        return float(np.linalg.norm(self.displacement, axis=1).max())

    def __repr__(self) -> str:
        """Say what was solved, and how."""
        report = self.report
        return (
            f"<Solution of {self.case}: {len(self.coordinates)} nodes, largest displacement "
            f"{self.largest_displacement:.6g} {self.units.length}, {report.load_steps} load steps, "
            f"{report.newton_iterations} Newton iterations, "
            f"residual {report.residual_norm:.2g} {self.units.force}>"
        )

    @checked_arguments
    def save(self, path: Path | str) -> None:
        """Write the fields to a file ``.npz``, ``.vtu`` or ``.xdmf``, as ``datagen solve`` does.

        With stresses, the file holds the reactions and the fields of the cells as well.

        Raises
        ------
        InputError
            If the file name has another ending, or there is no such folder.
        """
        fields = {"force": self.force, "displacement": self.displacement}
        if self.stresses:
            fields["reaction"] = self.reactions
        mesh = self.coordinates, self.cells, self.cell_type
        write_solution(Path(path), *mesh, fields, self.stresses, self.force_between)

    def plot(self) -> Figure:
        """Draw the deformed body with its displacement and forces, over the undeformed one."""
        from shared_schema.common.drawing.mesh_drawing import deformed_figure

        return deformed_figure(self, self.displacement, self.force)


@checked_arguments
def solve(
    case: CaseSource,
    load: Loads = (),
    *,
    forces: Sequence[Path | str] = (),
    held: Sequence[str] = (),
    tool: str | Tool | None = None,
    friction: float = 0.0,
    tool_from: Sequence[str | Sequence[float]] | Array = (),
    actuate: Sequence[str] = (),
    body_force: str | Sequence[float] | None = None,
    nearest: bool = False,
    start: Path | str | Array | None = None,
    stresses: bool = False,
    volumetric: Volumetric | None = None,
    changes: Sequence[str] = (),
    parameters: Mapping[str, float] = MappingProxyType({}),
    trust: bool = False,
    comm: Any = None,
) -> Solution:
    """Solve one load case; every rank that calls it solves for itself, unless they share it.

    Parameters
    ----------
    case, volumetric, changes, trust
        As for `datagen.cases.case.read_case`.
    load : str, sequence of str, or array (n_nodes, d)
        Loads as ``--load`` takes them (`shared_schema.common.bodies.command_loads`), or nodal
        forces in N.
    forces : sequence of paths
        Files of forces, ``.npz`` or ``.csv``, which act as well.
    held : sequence of str
        Prescribed displacements in m of nodes and groups, as ``--hold`` takes them, such as
        ``4,1:0,-0.1`` or ``tip:0,-``; ``-`` is a free component.
    tool : str or shared_schema.tools.Tool, optional
        A rigid tool that the nodes of the surface keep out of, such as ``sphere:4,1.1:0.3`` (centre
        and radius in m).
    friction : float
        Coulomb's coefficient μ of friction with the tool; it needs `tool_from`.
    tool_from : sequence of str or of d floats, or array (n, d)
        Where the tool comes from: displacements in m from its place, such as ``-0.5,0.3``, in turn;
        it goes from the first one over all others to its place. By default it grows into the body.
    actuate : sequence of str
        What is given of actuators of the case, such as ``left=2.5`` or ``left.length=0.12``
        (`shared_schema.actuators.PlacedActuators.given`).
    body_force : str or sequence of d floats, optional
        A force in N per m³ of the undeformed body that acts everywhere, such as its weight.
    nearest : bool
        Let forces beside a node act at the nearest one; the solution's `notes` say which.
    start : path or array (n_nodes, d), optional
        Displacement in m to start from, also of a file ``.npz``; by default the load is stepped up
        from rest.
    stresses : bool
        Compute stresses as well.
    parameters : mapping of str to float
        Those of the shape, of a case whose mesh has ranges of them; others, and all by default, are
        in the middle of their ranges.
    comm : mpi4py communicator, optional
        Its ranks share the body, and all return the same solution (collective).

    Raises
    ------
    InputError
        If the case, a load or the start is wrong or does not fit the mesh.
    WorkError
        If no equilibrium is found.
    """
    found = read_case(case, volumetric=volumetric, trust=trust, changes=changes)
    loads = load, forces, held, actuate, body_force, nearest, parameters
    needed = tool is None and not actuate
    with loaded_case(found, comm, *loads, needed=needed) as loaded:
        return _solved(loaded, start, stresses, Pushing(tool, friction, tool_from))


def _solved(
    loaded: LoadedCase,
    start: Path | str | Array | None,
    stresses: bool,
    pushing: Pushing,
) -> Solution:
    """Solve the body's problem, and collect the fields."""
    body, given, actuation = loaded.body, loaded.given, loaded.actuation
    problem, case, mesh = body.problem, body.case, body.mesh
    said = "" if isinstance(start, np.ndarray) else f" '{start}'"
    acts = given.surfaces or given.moved.any() or pushing.tool is not None
    if start is not None and (acts or not all(control.rests for control in actuation)):
        raise InputError(
            f"--start{said}: expected forces only, no pressure, --hold, --tool or --actuate"
        )
    problem.load.contact = pushing.on(body)
    for warning in body.warnings():
        logger.warning(warning)
    load, origin = loaded.dead, ""
    began = time.perf_counter()
    drive, between = (loaded.controls, given.displacement), given.forces_between
    with _shown(body) as begin:
        if start is None:
            report = solve_load_case(problem, *load, case.solver, *drive, begin, between)
        else:
            where = _start(start, mesh)
            report, used = solve_from(where, problem, *load, case.solver, begin, between)
            origin = "start" if used else "rest"
        report = with_stability(problem, report, case.solver)
    seconds = time.perf_counter() - began
    if not report.solved and report.load_factor == 1.0:
        raise WorkError(
            f"{report.explanation} (key 'solver.stability' = '{case.solver.stability}')"
        )
    if not report.solved:
        raise WorkError(
            f"no equilibrium found beyond {report.load_factor:.1%} of the load "
            f"({report.explanation}; {report.cutbacks} cutbacks)"
        )
    displacement, tolerance = problem.displacement(), problem.tolerance()
    contact = None if problem.load.contact is None else problem.load.contact.found(displacement)
    if contact is not None and contact.penetration > INSIDE * np.ptp(mesh.coordinates):
        raise WorkError(
            f"a node is {case.units.written(contact.penetration)} inside the tool, expected one "
            "that comes from outside of the body"
        )
    unusual = size_warning(displacement, mesh.coordinates, "the largest displacement")
    if unusual is not None:
        logger.warning(unusual)
    actuated, actuators = found_actuation(problem, len(actuation)), body.loads.actuators
    if problem_of_walls := actuators.wall_problem(problem.positions()):
        raise WorkError(problem_of_walls)
    if actuated is not None:
        given.actuation = actuators.forces_at_rest(actuated[:, 0], body.loads.positions)
    force, between, grip = given.at_rest, given.at_rest_between, problem.grip()
    if given.body.points is None or between is None:
        force = force + grip
    else:
        force = force + given.body.points.on_nodes(grip)
        between = between + grip[given.body.points.nodes :]
    return Solution(
        case=case.name,
        coordinates=mesh.coordinates,
        cells=mesh.cells,
        cell_type=mesh.cell_type,
        force=force + (0.0 if contact is None else contact.force),
        force_between=between if between is not None and between.any() else None,
        contact=contact,
        actuators={} if actuated is None else actuators.found(actuated),
        displacement=displacement,
        reactions=reactions_of_supports(problem, body.held),
        stresses=CellStresses(problem, case.materials, body.parts).fields() if stresses else {},
        report=report,
        tolerance=tolerance,
        origin=origin,
        unknowns=problem.size,
        linear_solver=problem.linear_solver,
        seconds=seconds,
        notes=tuple(given.notes),
        units=case.units,
    )


@contextmanager
def _shown(body: Body) -> Iterator[Callable[[float, float], None]]:
    """Show the progress of a load case, on rank 0; yield what is called at each load step."""
    problem, tolerance = body.problem, 0.0
    title = f"datagen solve {body.case.name}"
    progress = LoadProgress(title, body.case.units.force, silent=problem.comm.rank > 0)

    def begin(reached: float, target: float) -> None:
        nonlocal tolerance
        tolerance = problem.tolerance()
        progress.begin(reached, target)

    def step(number: int, residual: float) -> None:
        progress.step(number, residual, tolerance)

    problem.meanwhile = step
    try:
        yield begin
    finally:
        progress.close()


def _start(start: Path | str | Array, mesh: Mesh) -> Array:
    """Displacement to start from, (n_nodes, d)."""
    if not isinstance(start, np.ndarray):
        require_type("start", start, str | Path)
        return read_start(Path(start), mesh.coordinates)
    if start.shape != mesh.coordinates.shape:
        raise InputError(f"start of shape {start.shape}: expected {mesh.coordinates.shape}")
    return real_numbers(start, "displacements to start from")
