"""Displacements of all shipped cases under a few of their loads, kept to compare platforms by.

Versions of gmsh mesh a body in other ways, so the meshes that gmsh makes are kept as well.

    OMP_NUM_THREADS=1 .venv-datagen/bin/python -m tests.datagen.reference_displacements

writes them anew, which is needed only where a shipped case changes. The kept ones are made with
dolfinx 0.5.2, PETSc 3.18, gmsh 4.8 and NumPy 1.24 (Debian 12).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.cases.body import Body, make_body
from datagen.cases.case import SHIPPED, Case, read_case
from datagen.mesh.mesh_file import MeshFile
from datagen.solver.load_stepping import solve_load_case
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.materials import VOLUMETRIC_TERMS

FILE = Path(__file__).with_suffix(".json")
MESHES = Path(__file__).with_name("reference_meshes.npz")
SAME = (
    "beam3d_any",
    "beam3d_places",
    "beam3d_sweep",
)  # body of beam3d under single loads, as beam3d itself
ORGANS = ("breast3d", "liver3d", "liver3d_touch")  # met by AceFEM, loaded at all nodes
ACTUATED = ("actuator3d", "trunk3d")  # solved in `test_shipped_actuators`
SHAPES = ("plate2d_shapes",)  # another mesh in every sample, solved in `test_shapes`
MOVED = ("beam3d_motion",)  # the static body is that of beam3d, on fewer cells
LEFT_OUT = (*SAME, *ORGANS, *ACTUATED, *SHAPES, *MOVED)
CASES = sorted(path.stem for path in SHIPPED.glob("*.yaml") if path.stem not in LEFT_OUT)
FRACTIONS = {2: (0.0, 0.45, 1.0), 3: (0.0, 1.0)}  # of the samples of a case, by dimension
KEPT_NODES = 8
CELL_TYPES = {(2, 3): "triangle", (2, 4): "quad", (3, 4): "tetra", (3, 8): "hexahedron"}


@dataclass(frozen=True)
class KeptMesh:
    """The mesh of a case that the reference was made with, instead of one that gmsh makes now."""

    name: str

    def raw_mesh(self) -> RawMesh:
        """Read the mesh."""
        with np.load(MESHES) as file:
            groups = {
                key.rpartition(" ")[2]: file[key] for key in file if key.startswith(self.name + " ")
            }
        coordinates, cells = groups.pop("coordinates"), groups.pop("cells").astype(np.int64)
        return RawMesh(coordinates, cells, CELL_TYPES[coordinates.shape[1], cells.shape[1]], groups)


def body_of(case: Case) -> Body:
    """Body of a case, on the mesh of the reference."""
    if isinstance(case.mesh, MeshFile):
        case = case.model_copy(update={"mesh": KeptMesh(case.name)})
    return make_body(case, MPI.COMM_SELF)


def keep_meshes() -> None:
    """Write the meshes that gmsh makes."""
    arrays: dict[str, NDArray[Any]] = {}
    for name in CASES:
        mesh = read_case(name).mesh
        if isinstance(mesh, MeshFile):
            raw = mesh.raw_mesh()
            arrays[f"{name} coordinates"] = raw.coordinates
            arrays[f"{name} cells"] = raw.cells.astype(np.int16)
            arrays |= {f"{name} {group}": nodes for group, nodes in raw.groups.items()}
    np.savez_compressed(MESHES, **arrays)  # type: ignore[arg-type]


def samples_of(case: Case, dimension: int) -> list[int]:
    """Numbers of the samples whose displacements are kept: the first, the last, one between."""
    return [round(fraction * (case.dataset.samples - 1)) for fraction in FRACTIONS[dimension]]


def solved(case: Case, body: Body, sample: int) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Load of a sample as plain data, and the displacement under it: (n_nodes, d) in m."""
    load = body.loads[sample]
    report = solve_load_case(body.problem, load.nodes, load.forces, case.solver, load.controls)
    assert report.solved, report.explanation
    plain = {"nodes": load.nodes.tolist(), "forces": load.forces.tolist()}
    if len(load.pressures):
        plain["pressures"] = load.pressures.tolist()
    return plain, body.problem.displacement()


def kept_nodes(count: int) -> NDArray[np.intp]:
    """Numbers of the nodes whose displacements are kept."""
    return np.linspace(0, count - 1, KEPT_NODES).astype(np.intp)


def reference() -> dict[str, Any]:
    """Displacements of all cases and volumetric terms as plain data."""
    found: dict[str, Any] = {}
    for name in CASES:
        for volumetric in VOLUMETRIC_TERMS:
            case = read_case(name, volumetric=volumetric)
            body = body_of(case)
            for sample in samples_of(case, body.problem.dimension):
                load, u = solved(case, body, sample)
                found[f"{name} {volumetric} {sample}"] = {
                    "load": load,
                    "root_mean_square": float(np.sqrt(np.mean(u**2))),
                    "displacement": u[kept_nodes(len(u))].tolist(),
                }
            body.problem.close()
    return found


if __name__ == "__main__":
    keep_meshes()
    lines = (f"{json.dumps(key)}: {json.dumps(value)}" for key, value in reference().items())
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n")
