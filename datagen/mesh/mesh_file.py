"""Mesh from a file of the user: a gmsh script or mesh, CAD, a surface, or what meshio reads.

The file is read by another process, so that gmsh or a library that meshio uses can end (they may
crash, exit or ask a question) without ending this one.
"""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    Discriminator,
    Field,
    PrivateAttr,
    Tag,
    field_validator,
    model_validator,
)

from datagen.mesh.files.abaqus_file import is_of_abaqus, mesh_of_abaqus
from datagen.mesh.files.cad_file import is_cad, mesh_of_cad
from datagen.mesh.files.gmsh_file import (
    constants_of,
    is_of_gmsh,
    is_script,
    mesh_by_gmsh,
    require_harmless,
)
from datagen.mesh.files.image_file import is_image, mesh_of_image
from datagen.mesh.files.meshio_file import mesh_by_meshio
from datagen.mesh.files.script_shapes import OF_SHAPES, positions_of_shapes
from datagen.mesh.files.surface_file import SUFFIXES, is_surface, mesh_inside
from datagen.mesh.overlap import overlap_problem
from datagen.mesh.raw_mesh import read_raw_mesh, write_raw_mesh
from datagen.mesh.refinement import refined
from datagen.mesh.zones import OF_ZONES, with_zones
from shared_schema.common.bodies.equilibrium import mean_edge
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.bodies.shape_family import MOST, ShapeFamily, design
from shared_schema.common.configuration import Frozen, absent
from shared_schema.common.errors import InputError, first_line
from shared_schema.common.files import sha256
from shared_schema.common.units import Size
from shared_schema.loads.family import ascending

Parameter = Annotated[float, Field(ge=-1e12, le=1e12)]
Range = Annotated[tuple[Parameter, Parameter], AfterValidator(ascending)]


def _form(value: Any) -> str:
    return "(a range)" if isinstance(value, list | tuple) else "(a number)"


Parameters = dict[
    str,
    Annotated[
        Annotated[Parameter, Tag("(a number)")] | Annotated[Range, Tag("(a range)")],
        Discriminator(_form),
    ],
]
Label = Annotated[int, Field(ge=-(2**31), lt=2**32)]
FARTHEST = 0.05  # of a node of a shape from where the script puts it, over the mean edge
UNFIT = 3  # exit code of the process that reads a mesh, if it says what is wrong


class MeshFile(Frozen):
    """Mesh file: triangles or quadrilaterals in the plane, tetrahedra or hexahedra.

    Attributes
    ----------
    kind : "file"
        Kind of the geometry.
    path : str
        Path relative to the case file. gmsh meshes ``.geo``, CAD files (``.step``, ``.iges``,
        ``.brep``), the inside of closed surfaces (``.stl``, ``.obj``, ``.ply``) and the labels of
        images (``.nii``, ``.nii.gz``, ``.nrrd``, ``.mha``), and reads ``.msh``; meshio reads all
        other files but Abaqus' ``.inp``. Endings may be in capitals.
    size : float, optional
        Size of the cells before `scale`: that of a CAD file in m, of a surface in its unit, of an
        image in mm. Without it the triangles of a surface stay.
    sha256 : str, optional
        Checksum of the file and its zones. It is filled in when a case is read, so that a dataset
        belongs to one mesh.
    scale : float
        Factor on all coordinates of the file, such as 0.001 from mm to m. The lengths of the other
        kinds stand in the case itself.
    refine : int
        Number of times that every cell is divided, in four in the plane, in eight in space
        (`datagen.mesh.refinement`).
    parameters : mapping of str to float or tuple of 2 floats
        Values of constants that a gmsh script defines by ``DefineConstant``, of such a script only:
        each set of values is another shape of one family. Those of ranges [low, high] are drawn for
        every sample, and move the nodes of one mesh (`shared_schema.common.bodies.shape_family`).
    labels : mapping of str to int
        Labels of an image by the names of their groups of cells; all others are outside of the
        body. By default all but 0, under their numbers.
    smoothing : float
        Standard deviation in voxels of the Gaussian that blurs the labels of an image.
    zones : mapping of str to str
        Closed surfaces (``.stl``, ``.obj``, ``.ply``) in a body in space, in its unit before
        `scale`, by the names of the groups of the cells whose centres lie inside; all others are
        the group ``rest``. Paths are relative to the case file.
    """

    kind: Literal["file"]
    path: str = Field(min_length=1)
    size: Size | None = Field(None, exclude_if=absent)
    sha256: str | None = Field(None, pattern=r"^[0-9a-f]{64}$")
    scale: float = Field(1.0, ge=1e-12, le=1e12, exclude_if=lambda scale: scale == 1.0)
    refine: int = Field(0, ge=0, le=6, exclude_if=lambda refine: refine == 0)
    parameters: Parameters = Field({}, exclude_if=lambda parameters: not parameters)
    labels: dict[str, Label] = Field({}, exclude_if=lambda labels: not labels)
    smoothing: float = Field(1.0, ge=0, le=10, exclude_if=lambda smoothing: smoothing == 1.0)
    zones: dict[str, str] = Field({}, exclude_if=lambda zones: not zones)
    _folder: Path = PrivateAttr(default=Path())

    @field_validator("parameters", mode="before")
    @classmethod
    def _ranges_are_tuples(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        return {name: tuple(v) if isinstance(v, list) else v for name, v in value.items()}

    @model_validator(mode="after")
    def _has_keys_of_its_format(self) -> MeshFile:
        path, is_filled = self.path, is_surface(self.path) or is_image(self.path)
        for key, fits, kind in (
            ("size", is_filled or is_cad(path), "CAD file, no surface and no image"),
            ("parameters", is_script(path), "gmsh script"),
            ("labels", is_image(path), "image"),
            ("smoothing", is_image(path), "image"),
        ):
            if not fits and getattr(self, key) != type(self).model_fields[key].default:
                raise ValueError(f"'{key}' of '{path}': expected none, it is no {kind}")
        if self.size is None and (is_cad(path) or is_image(path)):
            unit = "m" if is_cad(path) else "mm"
            raise ValueError(f"'size' of '{path}': expected that of the cells in {unit}")
        for name, file in self.zones.items():
            if not is_surface(file):
                raise ValueError(
                    f"'zones.{name}' = '{file}': expected a closed surface, {', '.join(SUFFIXES)}"
                )
        return self

    @model_validator(mode="after")
    def _has_few_ranges(self) -> MeshFile:
        if self.ranges and self.refine:
            raise ValueError(f"'refine' = {self.refine}: expected none beside ranges of parameters")
        if len(self.ranges) > MOST:
            raise ValueError(f"'parameters': {len(self.ranges)} ranges, expected {MOST} at most")
        return self

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Parameters that are drawn for every sample."""
        return {name: r for name, r in self.parameters.items() if isinstance(r, tuple)}

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
        path, zones = folder / self.path, self._zones_in(folder)
        for key, file in {"path": path, **{f"zones.{n}": z for n, z in zones.items()}}.items():
            if not file.is_file():
                raise InputError(f"key 'mesh.{key}': no such file {file}")
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
        digest = sha256(path, *zones.values())
        if self.sha256 not in (None, digest):
            raise InputError(f"key 'mesh.sha256' = {self.sha256!r}: {path} has {digest}")
        found = self.model_copy(update={"sha256": digest})
        found._folder = folder
        return found

    def _zones_in(self, folder: Path) -> dict[str, Path]:
        return {name: folder / file for name, file in self.zones.items()}

    def raw_mesh(self) -> RawMesh:
        """Read the mesh, or generate it with gmsh.

        Raises
        ------
        InputError
            If meshing or reading fails, the mesh is unfit (see `datagen.mesh.raw_mesh`, and
            `overlap_problem`), or parameters in their ranges tangle it.
        """
        path = self._folder / self.path
        zones = {name: str(file.absolute()) for name, file in self._zones_in(self._folder).items()}
        options = self.model_copy(update={"zones": zones}).model_dump_json()
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
                return scaled(mesh, self.scale)
        problem = (done.stdout.strip().splitlines() or [""])[-1]  # libraries print before
        if done.returncode != UNFIT or not problem:
            problem = f"reading it ended with {_ending(done.returncode)}"
        key = f"mesh.path' = '{self.path}"
        if problem.startswith((OF_SHAPES, OF_ZONES)):
            key, _, problem = problem.partition(": ")
            key = f"mesh.{key}"
        raise InputError(f"key '{key}': {problem}")


def _ending(code: int) -> str:
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def scaled(mesh: RawMesh, scale: float) -> RawMesh:
    """Multiply all positions by a factor."""
    shapes = mesh.shapes
    if shapes is not None:
        shapes = replace(shapes, terms=scale * shapes.terms)
    return replace(mesh, coordinates=scale * mesh.coordinates, shapes=shapes)


def main(path: Path, result: Path, wanted: MeshFile) -> int:
    """Read a mesh and write its arrays to `result`, or print what is wrong with it."""
    try:
        ranges = wanted.ranges
        fixed = {n: v for n, v in wanted.parameters.items() if not isinstance(v, tuple)}
        middle = {name: (low + high) / 2 for name, (low, high) in ranges.items()}
        mesh = _read(path, wanted, {**fixed, **middle})
        problem = overlap_problem(mesh.coordinates, mesh.cells, mesh.cell_type)
        if problem is not None:
            raise ValueError(problem)
        if wanted.zones:
            mesh = with_zones(mesh, {name: Path(file) for name, file in wanted.zones.items()})
        if ranges:
            mesh = replace(mesh, shapes=_shapes(path, mesh, fixed, ranges))
        write_raw_mesh(result, mesh)
    except (Exception, SystemExit) as error:  # gmsh and meshio raise many types
        print(first_line(error))
        return UNFIT
    return 0


def _shapes(
    path: Path,
    mesh: RawMesh,
    fixed: Mapping[str, float],
    ranges: Mapping[str, tuple[float, float]],
) -> ShapeFamily:
    """Lay a polynomial through shapes of a script; ValueError if it misses others, or tangles."""
    low, high = np.array(list(ranges.values())).T
    beside = -np.ones((1, len(ranges)))  # the corner that is farthest from all others
    values = (low + high + np.concatenate([design(len(ranges)), beside]) * (high - low)) / 2
    constants = [{**fixed, **dict(zip(ranges, row, strict=True))} for row in values.tolist()]
    *positions, corner = positions_of_shapes(path, constants[0], constants[1:])
    found = ShapeFamily.through(ranges, np.array([mesh.coordinates, *positions]))
    if (tangled := found.tangled(mesh.cells, mesh.cell_type)) is not None:
        raise ValueError(f"{OF_SHAPES}{tangled}")
    missed = float(np.linalg.norm(found.coordinates(low) - corner, axis=1).max())
    if missed > FARTHEST * mean_edge(mesh.coordinates, mesh.cells):
        raise ValueError(
            f"{OF_SHAPES}{found.said(low)}: a quadratic function of them puts a node "
            f"{missed:.3g} beside its place, expected narrower ranges"
        )
    return found


def _read(path: Path, wanted: MeshFile, parameters: Mapping[str, float]) -> RawMesh:
    """Read a file by what reads files of its name."""
    if is_surface(path):
        return mesh_inside(path, wanted.size)
    if wanted.size is not None:
        if is_image(path):
            return mesh_of_image(path, wanted.size, wanted.labels, wanted.smoothing)
        return mesh_of_cad(path, wanted.size)
    if is_of_gmsh(path):
        return mesh_by_gmsh(path, parameters)
    return mesh_of_abaqus(path) if is_of_abaqus(path) else mesh_by_meshio(path)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2]), MeshFile.model_validate_json(sys.argv[3])))
