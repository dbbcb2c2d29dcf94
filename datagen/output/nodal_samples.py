"""The body of a dataset, and single samples of a nodal one, found by their number."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared_schema.actuators import PlacedActuators, actuators_of, placed_actuators
from shared_schema.common.bodies.command_loads import LoadedBody
from shared_schema.common.bodies.groups import cells_in, groups_of, parts_of
from shared_schema.common.bodies.nodal_forces import scatter_forces
from shared_schema.common.bodies.shape_family import TERMS
from shared_schema.common.errors import InputError
from shared_schema.common.units import Units
from shared_schema.dataset_reader import DatasetReader
from shared_schema.layout import Arrays
from shared_schema.manifest import ShardEntry

Array = NDArray[np.float64]


class DatasetBody:
    """What every dataset says of its body, with samples or without.

    Parameters
    ----------
    reader : DatasetReader
    arrays : mapping of str to array
        Those of one of its shards.

    Attributes
    ----------
    manifest : Manifest
    units : Units
        Labels of the units of the case.
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
    cell_type : str
        meshio's name.
    has_shapes : bool
        True if every sample has a shape of its own.
    clamped, loadable : array of bool, (n_nodes,)
    fibres : array, (n_cells, families, d), or None
        Directions of fibres, if a material has some.
    groups : mapping of str to (array of bool, (n_nodes,), and array of bool, (n_cells,))
        Nodes and cells of every named group.
    held : array of bool, (n_nodes, d)
        Components of displacement that supports hold.
    """

    def __init__(self, reader: DatasetReader, arrays: Arrays) -> None:
        self.manifest = reader.manifest
        self.units = Units.of_case(self.manifest.case)
        self.coordinates: NDArray[np.float64] = arrays["mesh/coordinates"]
        self.cells: NDArray[np.int64] = arrays["mesh/cells"]
        self.clamped: NDArray[np.bool_] = arrays["mesh/clamped"]
        self.loadable: NDArray[np.bool_] = arrays["mesh/loadable"]
        self.fibres: NDArray[np.float64] | None = arrays.get("mesh/fibres")
        parts = parts_of(arrays, reader.cell_type)
        self.groups = {
            name: (members, cells_in(self.cells, members, parts.get(name)))
            for name, members in groups_of(arrays).items()
        }
        self.cell_type, self.has_shapes = reader.cell_type, TERMS in arrays
        single = arrays.get("mesh/held")
        whole = np.repeat(self.clamped[:, None], self.coordinates.shape[1], axis=1)
        self.held: NDArray[np.bool_] = whole if single is None else single
        self._groups = groups_of(arrays), parts_of(arrays, self.cell_type)

    @cached_property
    def actuators(self) -> PlacedActuators:
        """Cables and chambers of the case, on the nodes of the mesh.

        Raises
        ------
        InputError
            If they do not fit the mesh.
        """
        (groups, parts), content = self._groups, self.manifest.case.get("actuators") or {}
        known = self.coordinates, self.cells, self.cell_type, self.held
        try:
            found = actuators_of(content)
        except ValueError as error:
            raise InputError(f"{self.manifest.name}: key 'actuators': {error}") from None
        return placed_actuators(found, LoadedBody(*known, groups, parts=parts))


@dataclass(frozen=True)
class Sample:
    """One equilibrium.

    Attributes
    ----------
    number : int
    force : array, (n_nodes, d)
        In N.
    displacement : array, (n_nodes, d)
        In m.
    pressures : array, (n_surfaces,)
        Pressure on each surface in Pa.
    coordinates : array, (n_nodes, d)
        Of the undeformed body, in m.
    amplitudes : array, (n_actuators,)
        Tension in N or pressure in Pa of each actuator.
    """

    number: int
    force: NDArray[np.float64]
    displacement: NDArray[np.float64]
    pressures: NDArray[np.float64]
    coordinates: NDArray[np.float64]
    amplitudes: NDArray[np.float64]


class NodalSamples(DatasetBody):
    """The body and the samples of a nodal dataset; one shard at a time is in memory.

    Parameters
    ----------
    folder : Path

    Attributes
    ----------
    parts : array of int, (n_cells,), or None
        Position of each cell's material in the case, if it has several.
    surfaces : list of array of int, (n_facets, n_corners)
        Facets of the surfaces under pressure, seen from outside.
    numbers : array of int, (n_samples,)
        Numbers of the solved samples, ascending.
    largest : array, (n_samples,)
        Largest displacement of a node in each of them, in m.

    Raises
    ------
    InputError
        If the folder holds no intact nodal dataset, or no sample of it is solved.
    """

    def __init__(self, folder: Path) -> None:
        self._reader = DatasetReader(folder, "nodal")
        if self._reader.manifest.samples == 0:
            raise InputError(f"{folder}: no solved sample, expected 1 at least")
        self._entry_of: dict[int, ShardEntry] = {}
        largest: dict[int, float] = {}
        for entry, arrays in self._reader:
            numbers = arrays["samples/number"].tolist()
            moved = np.linalg.norm(arrays["samples/displacement"], axis=2).max(axis=1)
            self._entry_of |= dict.fromkeys(numbers, entry)
            self._loaded, self._arrays = entry, arrays
            largest |= dict(zip(numbers, moved.tolist(), strict=True))
        self.numbers = np.array(sorted(largest))
        self.largest = np.array([largest[number] for number in sorted(largest)])
        super().__init__(self._reader, self._arrays)
        self.parts: NDArray[np.int64] | None = self._arrays.get("mesh/material")
        self.surfaces: list[NDArray[np.int64]] = []
        if "mesh/pressed" in self._arrays:
            facets, of = self._arrays["mesh/pressed"], self._arrays["mesh/pressed_surface"]
            if facets.size and not 0 <= facets.min() <= facets.max() < len(self.coordinates):
                raise InputError(f"{folder}: 'mesh/pressed' names a node outside the mesh")
            self.surfaces = [facets[of == i] for i in np.unique(of)]

    @property
    def are_motions(self) -> bool:
        """True if the samples have frames."""
        return "frames/time" in self._arrays

    def frames(self, number: int) -> Iterator[tuple[float, Array, Array]]:
        """Yield time in s, displacement in m and velocity in m/s, (n_nodes, d), of a motion."""
        row, arrays = self._row(number), self._arrays
        moved = (arrays[f"samples/frame_{name}"][row] for name in ("displacement", "velocity"))
        for at, u, v in zip(arrays["frames/time"], *moved, strict=True):
            yield float(at), u, v

    def _row(self, number: int) -> int:
        """Row of a sample in its shard, which is read if it is not the last one."""
        entry = self._entry_of[number]
        if entry != self._loaded:
            self._loaded, self._arrays = entry, self._reader.shard(entry)
        return int(self._arrays["samples/number"].tolist().index(number))

    def __getitem__(self, number: int) -> Sample:
        """Read a solved sample; consecutive samples of one shard read the shard once."""
        row = self._row(number)
        nodes = self._arrays["samples/loaded_nodes"][row]
        loads = self._arrays["samples/force"][row]
        force = scatter_forces(nodes, loads, len(self.coordinates))
        pressures = np.zeros(0)
        if self.surfaces:
            pressures = self._arrays["samples/pressure"][row]
        shapes = self._arrays.get("samples/coordinates")
        x = self.coordinates if shapes is None else shapes[row]
        amplitudes = self._arrays.get("samples/amplitude", np.zeros((row + 1, 0)))[row]
        displacement = self._arrays["samples/displacement"][row]
        return Sample(number, force, displacement, pressures, x, amplitudes)

    def named(self, text: str) -> list[int]:
        """Parse ``--samples N,N,…``, the numbers of solved samples; keep their order.

        Raises
        ------
        InputError
            If the text is no list of different sample numbers, or one of them was not solved.
        """
        if not re.fullmatch(r"\d{1,15}(,\d{1,15})*", text, re.ASCII):
            raise InputError(f"--samples '{text}': expected sample numbers N,N,…")
        numbers = [int(number) for number in text.split(",")]
        if len(set(numbers)) < len(numbers):
            raise InputError(f"--samples '{text}': expected each sample number once")
        for number in numbers:
            if number not in self._entry_of:
                raise InputError(
                    f"--samples '{text}': no sample {number} was solved, expected numbers of "
                    f"solved ones, {self.numbers[0]} to {self.numbers[-1]}"
                )
        return numbers

    def within(self, text: str) -> list[int]:
        """Parse ``--samples A:B``, a half-open range, into the numbers of its solved samples.

        Raises
        ------
        InputError
            If the text is no such range, reaches beyond the last sample, or holds no solved sample.
        """
        match = re.fullmatch(r"(\d{1,15}):(\d{1,15})", text, re.ASCII)
        end = self.manifest.samples + self.manifest.failed
        if match is None or not int(match[1]) < int(match[2]) <= end:
            raise InputError(f"--samples '{text}': expected A:B with 0 <= A < B <= {end}")
        first, last = int(match[1]), int(match[2])
        numbers = self.numbers[(self.numbers >= first) & (self.numbers < last)].tolist()
        if not numbers:
            raise InputError(f"--samples '{text}': none of these load cases was solved")
        return [int(number) for number in numbers]

    def evenly_by_displacement(self, count: int) -> list[int]:
        """Choose up to `count` samples at equal steps in the order of largest displacement.

        k/n of all samples have no larger displacement than the k-th of n chosen ones; so the last
        one has the largest displacement of all.
        """
        order = np.argsort(self.largest, kind="stable")
        count = min(count, len(order))
        ranks = -(-np.arange(1, count + 1) * len(order) // count) - 1
        return [int(number) for number in self.numbers[order[ranks]]]
