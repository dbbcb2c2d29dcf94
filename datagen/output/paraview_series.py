"""Time series for ParaView: frames of a motion, or samples of a nodal dataset.

The time of a sample is its number.

An ``.xdmf`` file refers to an ``.h5`` file beside it that holds the arrays; a ``.pvd`` file refers
to a folder beside it with one ``.vtu`` file per frame. Points are those of the undeformed mesh,
with ``displacement`` in m and ``force`` in N, three components each, float64. With stresses they
also have ``reaction`` in N, and the cells the fields of
`shared_schema.common.bodies.equilibrium`.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import h5py
import numpy as np
from meshio.xdmf import TimeSeriesWriter
from numpy.typing import NDArray

from datagen.output.nodal_samples import NodalSamples, Sample
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError
from shared_schema.common.files import PARTIAL, complete_or_absent
from shared_schema.common.machine import require_memory
from shared_schema.common.progress import Progress
from shared_schema.common.solution_file import flat, in_space, require_suffix, write_solution
from shared_schema.materials import as_tuple, materials_of

SUFFIXES = (".xdmf", ".pvd")
FIRST = 100  # number of samples, if no range is given
BYTES = 144, 480  # of a node, and of a cell with stresses: twice what the file has
MADE_BY = "made_by"  # attribute of an .h5 file that this module wrote
OURS = "datagen export"


Fields = tuple[dict[str, Any], dict[str, Any]]  # of the nodes, and of the cells
Timed = tuple[float, dict[str, Any], dict[str, Any]]  # after a time, or the number of a sample
Mesh = tuple[NDArray[np.float64], NDArray[np.int64], str]  # positions, cells and their type


@checked_arguments
def export(
    nodal: Path | str,
    out: Path | str,
    *,
    samples: str | range | None = None,
    stresses: bool = False,
) -> list[int]:
    """Write samples as a time series, whose files appear complete or not at all.

    Parameters
    ----------
    nodal : Path or str
        Nodal dataset.
    out : Path or str
        File to write, ending in .xdmf or .pvd.
    samples : str or range, optional
        Half-open range of sample numbers, also as text A:B; otherwise the first 100 samples. Load
        cases in it that could not be solved are left out. Of motions, the frames of one sample are
        written, with their times.
    stresses : bool
        Compute stresses and reactions as well.

    Returns
    -------
    list of int
        Numbers of the samples written.

    Raises
    ------
    InputError
        If there is no intact nodal dataset, it has no such samples, or the file or folder beside
        `out` would replace something that was not exported before; the arrays of an .xdmf file do
        not fit the memory; with `stresses`, if the dataset has no record of the energy of a user's
        own material (earlier versions).
    OSError
        If the files cannot be written.
    """
    folder, path = Path(nodal), Path(out)
    require_suffix(path, SUFFIXES)
    _require_replaceable(path, _data_of(path))
    dataset = NodalSamples(folder)
    if dataset.has_shapes:
        raise InputError(f"{folder}: every sample has its own shape, expected a dataset of one")
    if samples is None:
        numbers = [int(number) for number in dataset.numbers[:FIRST]]
    else:
        text = samples if isinstance(samples, str) else f"{samples.start}:{samples.stop}"
        numbers = dataset.within(text)
    if dataset.are_motions:
        if len(numbers) > 1 or stresses:
            given = "--stresses" if stresses else f"{len(numbers)} samples"
            raise InputError(
                f"{folder}: the samples are motions: {given}: expected --samples of one"
            )
    elif path.suffix == ".xdmf":
        size = BYTES[0] * len(dataset.coordinates) + BYTES[1] * len(dataset.cells) * stresses
        what = f"--out '{path}': {len(numbers)} samples in one file (--samples, or .pvd)"
        require_memory(size * len(numbers), what)
    fields = _with_stresses(dataset, folder) if stresses else _fields
    mesh = dataset.coordinates, dataset.cells, dataset.cell_type
    frames: Iterator[Timed] = ((each.number, *fields(each)) for each in _in_turn(dataset, numbers))
    if dataset.are_motions:
        frames = (in_motion(*frame) for frame in dataset.frames(numbers[0]))
    write_series(path, mesh, frames)
    return numbers


def write_series(path: Path, mesh: Mesh, frames: Iterable[Timed]) -> None:
    """Write fields over time, whose files appear complete or not at all.

    Parameters
    ----------
    path : Path
        Ending in .xdmf or .pvd.
    mesh : (array (n_nodes, d), array of int (n_cells, n_corners), str)
    frames : iterable of (float, mapping of fields of nodes, mapping of fields of cells)
        At increasing times.

    Raises
    ------
    InputError
        If the file or folder beside `path` would replace something that was not exported before.
    """
    data = _data_of(path)
    _require_replaceable(path, data)
    write = _write_xdmf if path.suffix == ".xdmf" else _write_pvd
    with _both(path, data) as (partial, partial_data):
        write(partial, partial_data, data.name, mesh, frames)


def in_motion(at: float, displacement: NDArray[np.float64], velocity: NDArray[np.float64]) -> Timed:
    """One frame of a motion."""
    return at, {"displacement": in_space(displacement), "velocity": in_space(velocity)}, {}


def _data_of(path: Path) -> Path:
    """File or folder beside an index that holds its arrays."""
    return path.with_suffix(".h5" if path.suffix == ".xdmf" else "")


def _with_stresses(dataset: NodalSamples, folder: Path) -> Callable[[Sample], Fields]:
    """Make the function that computes the fields of a sample with stresses and reactions."""
    from mpi4py import MPI

    from datagen.discretisation.element import element_kind
    from datagen.mesh.distributed_mesh import distributed
    from datagen.output.cell_stresses import CellStresses, reactions_of_supports
    from datagen.solver.equilibrium import EquilibriumProblem
    from datagen.solver.settings import SolverSettings
    from shared_schema.actuators import pressed
    from shared_schema.common.bodies.following_loads import PressedSurface
    from shared_schema.common.bodies.groups import RawMesh

    element = dataset.manifest.case.get("element", "linear")
    if not element_kind(element, dataset.cell_type).corners_only:
        raise InputError(
            f"{folder}: key 'element' = '{element}': the dataset has no displacements between the "
            "corners of the cells, which stresses need; expected `datagen solve --stresses`"
        )
    material = materials_of(dataset.manifest.case.get("material"), f"{folder}: case.material")
    count, parts = len(as_tuple(material)), dataset.parts
    if count > 1 and (parts is None or not np.all((parts >= 0) & (parts < count))):
        raise InputError(f"{folder}: 'mesh/material' does not name the {count} materials")
    mesh = RawMesh(dataset.coordinates, dataset.cells, dataset.cell_type)
    problem = EquilibriumProblem(
        distributed(mesh, MPI.COMM_SELF),
        material,
        dataset.held,
        SolverSettings(tolerance=1.0, linear_solver="lu"),  # nothing is solved
        element,
        parts=dataset.parts,
        following=(*map(PressedSurface, dataset.surfaces), *dataset.actuators.loads),
        fibres=dataset.fibres,
    )
    cells = CellStresses(problem, as_tuple(material), dataset.parts)
    nothing = np.empty(0, dtype=np.int64), np.empty((0, problem.dimension))
    problem.load_factor = 1.0

    def fields(sample: Sample) -> Fields:
        problem.set_load(*nothing, pressed((*sample.pressures, *sample.amplitudes)))
        problem.set_displacement(sample.displacement)
        nodal, _ = _fields(sample)
        reaction = in_space(reactions_of_supports(problem, dataset.held))
        return {**nodal, "reaction": reaction}, cells.fields()

    return fields


def _in_turn(dataset: NodalSamples, numbers: list[int]) -> Iterator[Sample]:
    progress = Progress(len(numbers), 0, "samples", f"datagen export {dataset.manifest.name}")
    for done, number in enumerate(numbers, 1):
        yield dataset[number]
        progress.update(done)
    progress.close()


def _write_xdmf(path: Path, data: Path, name: str, mesh: Mesh, frames: Iterable[Timed]) -> None:
    with _Series(path, name) as series:
        coordinates, cells, cell_type = mesh
        series.write_points_cells(in_space(coordinates), [(cell_type, cells)])
        for at, nodal, of_cells in frames:
            by_block = {name: [flat(values)] for name, values in of_cells.items()}
            series.write_data(at, nodal, by_block)
        series.h5_file.flush()
        data.write_bytes(series.h5_file.id.get_file_image())


class _Series(TimeSeriesWriter):
    """meshio's writer, with the arrays in memory instead of a file in the working folder.

    HDF5 crashes if the disk is full, where Python raises an OSError.

    Parameters
    ----------
    path : Path
        Path of the index to write.
    name : str
        Name of the file of the arrays in the index.
    """

    def __init__(self, path: Path, name: str) -> None:
        super().__init__(path)
        self.h5_filename = name
        self.h5_file = h5py.File(name, "w", driver="core", backing_store=False)
        self.h5_file.attrs[MADE_BY] = OURS

    def __enter__(self) -> _Series:
        return self


def _write_pvd(path: Path, data: Path, name: str, mesh: Mesh, frames: Iterable[Timed]) -> None:
    data.mkdir()
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    for number, (at, nodal, of_cells) in enumerate(frames):
        file = f"sample-{at if isinstance(at, int) else number:05d}.vtu"
        write_solution(data / file, *mesh, nodal, of_cells)
        attributes = {"timestep": f"{at:.12g}", "file": f"{name}/{file}"}
        ElementTree.SubElement(collection, "DataSet", attributes)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _fields(sample: Sample) -> Fields:
    nodal = {"displacement": in_space(sample.displacement), "force": in_space(sample.force)}
    return nodal, {}


def _require_replaceable(path: Path, data: Path) -> None:
    """Raise InputError if the data would replace something that was not exported before."""
    if path.suffix == ".xdmf" and ":" in path.name:
        raise InputError(f"--out '{path}': expected a file name without ':' for .xdmf")
    if not (data.exists() or data.is_symlink()):
        return
    ours = _is_our_folder(data) if data.is_dir() else _is_our_file(data)
    if data.is_symlink() or not ours:
        raise InputError(f"--out '{path}': would replace {data}, which holds something else")


def _is_our_folder(data: Path) -> bool:
    return all(re.fullmatch(r"sample-\d{5,}\.vtu", file.name) for file in data.iterdir())


def _is_our_file(data: Path) -> bool:
    try:
        with h5py.File(data, "r") as file:
            return bool(file.attrs.get(MADE_BY) == OURS)
    except OSError:
        return False


@contextmanager
def _both(path: Path, data: Path) -> Iterator[tuple[Path, Path]]:
    """Yield temporary paths for an index and its data, which then replace the old ones together.

    The old index is removed before the old data, so that no index ever refers to other data.
    """
    partial_data = data.with_name(f"{PARTIAL}{os.getpid()}-{data.name}")
    try:
        with complete_or_absent(path) as partial:
            yield partial, partial_data
            path.unlink(missing_ok=True)
            _remove(data)
            partial_data.replace(data)
    except OSError as error:
        if str(partial_data) not in str(error.filename):
            raise
        raise OSError(error.errno, error.strerror, str(data)) from error
    finally:
        _remove(partial_data)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
