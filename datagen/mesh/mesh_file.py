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
from typing import Annotated, Literal

from pydantic import Field, PrivateAttr, model_validator

from datagen.mesh.files.abaqus_file import is_of_abaqus, mesh_of_abaqus
from datagen.mesh.files.cad_file import is_cad, mesh_of_cad
from datagen.mesh.files.gmsh_file import (
    constants_of,
    is_of_gmsh,
    is_script,
    mesh_by_gmsh,
    require_harmless,
)
from datagen.mesh.files.meshio_file import mesh_by_meshio
from datagen.mesh.files.surface_file import is_surface, mesh_inside
from datagen.mesh.overlap import overlap_problem
from datagen.mesh.raw_mesh import read_raw_mesh, write_raw_mesh
from datagen.mesh.refinement import refined
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.configuration import Frozen, absent
from shared_schema.common.errors import InputError, first_line
from shared_schema.common.files import sha256
from shared_schema.common.units import Size

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
        all other files but Abaqus' ``.inp``. Endings may be in capitals.
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
        if self.parameters and not is_script(self.path):
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
        if is_of_gmsh(path) and not trust:
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
        mesh = _read(path, size, parameters)
        problem = overlap_problem(mesh.coordinates, mesh.cells, mesh.cell_type)
        if problem is not None:
            raise ValueError(problem)
        write_raw_mesh(result, mesh)
    except (Exception, SystemExit) as error:  # gmsh and meshio raise many types
        print(first_line(error))
        return UNFIT
    return 0


def _read(path: Path, size: float | None, parameters: Mapping[str, float]) -> RawMesh:
    """Read a file by what reads files of its name."""
    if is_surface(path):
        return mesh_inside(path, size)
    if size is not None:
        return mesh_of_cad(path, size)
    if is_of_gmsh(path):
        return mesh_by_gmsh(path, parameters)
    return mesh_of_abaqus(path) if is_of_abaqus(path) else mesh_by_meshio(path)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2]), **json.loads(sys.argv[3])))
