"""Mesh from a file of the user: a gmsh script or mesh, CAD, a surface, or what meshio reads.

The file is read by another process, so that gmsh or a library that meshio uses can end (they may
crash, exit or ask a question) without ending this one.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from datagen.mesh.cad_file import is_cad, mesh_of_cad
from datagen.mesh.gmsh_model import gmsh_session, mesh_of
from datagen.mesh.gmsh_script import constants_of, require_harmless
from datagen.mesh.overlap import overlap_problem
from datagen.mesh.raw_mesh import RawMesh, raw_mesh, read_raw_mesh, write_raw_mesh
from datagen.mesh.refinement import refined
from datagen.mesh.surface_file import is_surface, mesh_inside
from datagen.quantities import Size
from shared_schema.common.checksum import sha256
from shared_schema.common.configuration import Frozen, absent
from shared_schema.common.errors import InputError, first_line

OF_GMSH = (".geo", ".msh")
Parameter = Annotated[float, Field(ge=-1e12, le=1e12)]
UNFIT = 3  # exit code of the process that reads a mesh, if it says what is wrong


class MeshFile(Frozen):
    """Mesh file: triangles or quadrilaterals in the plane, tetrahedra or hexahedra.

    Attributes
    ----------
    kind : "file"
        Kind of the geometry.
    path : str
        Path relative to the case file. gmsh meshes ``.geo``, CAD files (``.step``, ``.iges``,
        ``.brep``) and the inside of closed surfaces (``.stl``), and reads ``.msh``; meshio reads
        all other files.
    size : float, optional
        Size of the cells in m before `scale`, of a CAD file or a surface only. Without it the
        triangles of a surface stay.
    sha256 : str, optional
        Checksum of the file. It is filled in when a case is read, so that a dataset belongs to one
        mesh.
    scale : float
        Factor on all coordinates of the file, such as 0.001 from mm to m. The lengths of the other
        kinds stand in the case itself.
    refine : int
        Number of times that every cell is divided, in four in the plane, in eight in space
        (`datagen.mesh.refinement`).
    parameters : mapping of str to float
        Values of constants that a gmsh script defines by ``DefineConstant``, of such a script only:
        each set of values is another shape of one family.
    """

    kind: Literal["file"]
    path: str = Field(min_length=1)
    size: Size | None = Field(None, exclude_if=absent)
    sha256: str | None = Field(None, pattern=r"^[0-9a-f]{64}$")
    scale: float = Field(1.0, ge=1e-12, le=1e12, exclude_if=lambda scale: scale == 1.0)
    refine: int = Field(0, ge=0, le=6, exclude_if=lambda refine: refine == 0)
    parameters: dict[str, Parameter] = Field({}, exclude_if=lambda parameters: not parameters)
    _folder: Path = PrivateAttr(default=Path())

    @model_validator(mode="after")
    def _has_size_of_cad(self) -> MeshFile:
        given = self.size is not None
        if is_cad(self.path) and not given:
            raise ValueError(f"'size' of '{self.path}': expected that of the cells in m")
        if given and not is_cad(self.path) and not is_surface(self.path):
            raise ValueError(
                f"'size' of '{self.path}': expected none, it is no CAD file and no surface"
            )
        return self

    @model_validator(mode="after")
    def _has_parameters_of_a_script(self) -> MeshFile:
        if self.parameters and Path(self.path).suffix != ".geo":
            raise ValueError(f"'parameters' of '{self.path}': expected none, it is no gmsh script")
        return self

    def found_from(self, folder: Path, trust: bool = False) -> MeshFile:
        """Copy this mesh file with its path resolved against `folder` and its checksum filled in.

        Parameters
        ----------
        folder : Path
            Folder of the case file.
        trust : bool
            Allow all commands of a gmsh script.

        Raises
        ------
        InputError
            If there is no such file, its checksum differs from the given one, or gmsh would do more
            with it than to make or read a mesh.
        """
        path = folder / self.path
        if not path.is_file():
            raise InputError(f"key 'mesh.path' = '{self.path}': no such file {path}")
        if path.suffix in OF_GMSH and not trust:
            try:
                require_harmless(path)
            except (ValueError, OSError) as error:
                raise InputError(f"key 'mesh.path' = '{self.path}': {error}") from None
        for name in self.parameters:
            if name not in (known := constants_of(path)):
                defined = f"defines {', '.join(sorted(known))}" if known else "defines no constant"
                raise InputError(
                    f"key 'mesh.parameters.{name}': '{self.path}' {defined}, expected a constant "
                    "of its DefineConstant"
                )
        digest = sha256(path)
        if self.sha256 not in (None, digest):
            raise InputError(f"key 'mesh.sha256' = {self.sha256!r}: {path} has {digest}")
        found = self.model_copy(update={"sha256": digest})
        found._folder = folder
        return found

    def raw_mesh(self) -> RawMesh:
        """Read the mesh, or generate it with gmsh.

        Raises
        ------
        InputError
            If meshing or reading fails, or the mesh is unfit (see `datagen.mesh.raw_mesh`, and
            `overlap_problem`).
        """
        path = self._folder / self.path
        options = json.dumps({"size": self.size, "parameters": self.parameters})
        with TemporaryDirectory() as folder:
            result = Path(folder) / "mesh.npz"
            done = subprocess.run(
                [sys.executable, "-m", __name__, str(path.absolute()), str(result), options],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                errors="replace",
                check=False,
            )
            if done.returncode == 0 and result.is_file():
                mesh = read_raw_mesh(result)
                for _ in range(self.refine):
                    mesh = refined(mesh)
                return replace(mesh, coordinates=self.scale * mesh.coordinates)
        problem = (done.stdout.strip().splitlines() or [""])[-1]  # libraries print before
        if done.returncode != UNFIT or not problem:
            problem = f"reading it ended with {_ending(done.returncode)}"
        raise InputError(f"key 'mesh.path' = '{self.path}': {problem}")


def _ending(code: int) -> str:
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def main(path: Path, result: Path, size: float | None, parameters: Mapping[str, float]) -> int:
    """Read a mesh and write its arrays to `result`, or print what is wrong with it."""
    try:
        if is_surface(path):
            mesh = mesh_inside(path, size)
        elif size is not None:
            mesh = mesh_of_cad(path, size)
        else:
            mesh = _by_gmsh(path, parameters) if path.suffix in OF_GMSH else _by_meshio(path)
        problem = overlap_problem(mesh.coordinates, mesh.cells, mesh.cell_type)
        if problem is not None:
            raise ValueError(problem)
        write_raw_mesh(result, mesh)
    except (Exception, SystemExit) as error:  # gmsh and meshio raise many types
        print(first_line(error))
        return UNFIT
    return 0


def _by_gmsh(path: Path, parameters: Mapping[str, float]) -> RawMesh:
    """Open a file in gmsh, and generate its mesh unless it holds one."""
    if path.suffix == ".geo" and not path.read_bytes().endswith(b"\n"):
        raise ValueError(
            "expected a line feed at the end, gmsh leaves out what stands after the last"
        )
    with gmsh_session(parameters) as gmsh:
        gmsh.open(str(path))
        if len(gmsh.model.mesh.getElements()[0]) == 0:
            gmsh.model.mesh.generate(gmsh.model.getDimension())
        return mesh_of(gmsh.model)


def _by_meshio(path: Path) -> RawMesh:
    """Read a file by meshio; its point and cell sets become groups of nodes."""
    import meshio

    try:
        mesh = meshio.read(path)
    except (Exception, SystemExit) as error:
        raise ValueError(f"meshio finds no mesh with cells in it ({first_line(error)})") from None
    blocks = [(block.type, np.asarray(block.data, dtype=np.int64)) for block in mesh.cells]
    groups: dict[str, Any] = {name: np.asarray(m) for name, m in mesh.point_sets.items()}
    for name, members in mesh.cell_sets.items():
        nodes = [
            cells[np.asarray(chosen, dtype=np.int64)].ravel()
            for (_, cells), chosen in zip(blocks, members, strict=True)
            if chosen is not None and len(chosen)
        ]
        groups[name] = np.unique(np.concatenate([groups.get(name, np.empty(0, int)), *nodes]))
    points = np.asarray(mesh.points, dtype=np.float64)
    numbered = {k: np.asarray(v, dtype=np.int64) for k, v in groups.items()}
    return raw_mesh(points, blocks, numbered, mesh.cell_sets)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2]), **json.loads(sys.argv[3])))
