"""No public call writes to what it is given, or reads again what it has returned."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import shared_schema
from shared_schema import (
    DatasetReader,
    Grid,
    LoadCases,
    Manifest,
    NeoHookean,
    OwnMaterial,
    Stiffness,
    tools,
)
from shared_schema.common.units import SI
from shared_schema.materials import ARRAYS, Functions, Invariants, Material, Scalar
from tests.aliasing import public_functions, public_names, require_no_aliases
from tests.closed_surfaces import surface_file
from tests.shared_schema.conftest import make_dataset, make_nodal

Given = dict[str, Any]
GAPS = ("gap", "normal", "curvature")
MATERIAL = NeoHookean(young_modulus=500.0, poisson_ratio=0.4)


class Gel(OwnMaterial):
    """A user's own material."""

    shear: float

    def energy(self, c: Invariants, of: Functions) -> Scalar:
        """W = μ/2 (I₁ − 3 − 2 ln J) + μ (J − 1)²."""
        return self.shear * ((c.i1 - 3) / 2 - of.ln(c.j) + (c.j - 1) ** 2)


OWN = Gel(model="gel.py:Gel", shear=170.0)


class World:
    """What the calls are made on."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()
        self.nodal = make_dataset(folder / "nodal", "nodal")
        self.structured = make_dataset(folder / "structured", "structured")

    @cached_property
    def reader(self) -> DatasetReader:
        return DatasetReader(self.nodal)

    @property
    def manifest(self) -> Manifest:
        return self.reader.manifest

    @cached_property
    def grid(self) -> Grid:
        return shared_schema.grid_of(DatasetReader(self.structured).body)

    @cached_property
    def mesh(self) -> tools.Mesh:
        path = self.folder / "cube.stl"
        surface_file(path)
        return tools.Mesh(path)

    @cached_property
    def tools(self) -> list[tools.Tool]:
        """One of every kind."""
        sphere = tools.Sphere((0.0, 0.0, 0.0), 0.5)
        return [
            sphere,
            tools.Capsule((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.2),
            tools.Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.5)),
            tools.Displaced(sphere, (0.1, 0.0, 0.0)),
            self.mesh,
        ]


def arguments() -> Given:
    """Arrays and mappings that a caller may give."""
    rng = np.random.default_rng(3)
    return {
        "nodal": rng.normal(size=(2, 8, 2)),
        "grid": rng.normal(size=(2, 2, 3, 3)),
        "chosen": rng.normal(size=8) > 0,
        "order": np.arange(8)[::-1].copy(),
        "coordinates": np.argwhere(np.ones((4, 2))).astype(float),
        "node at": np.array([[0, 1], [2, -1]]),
        "points": np.array([[0.6, 0.1, 0.0], [0.0, -0.7, 0.2]]),
        "free": np.ones((2, 3), bool),
        "force": np.array([[1.0, 2.0], [0.0, 0.0]]),
        "arrays": make_nodal([0, 1], [2]),
        "content": {"b": [1, 2], "a": 3.0},
        "cells": np.array([[0, 2, 3, 1]]),
        "inside": np.array([[0.25, 0.5]]),
    }


def told(name: str) -> Callable[[World, Given], Any]:
    """What every tool tells of some points, or of itself."""
    if name in GAPS:
        return lambda w, g: [getattr(tool, name)(g["points"]) for tool in w.tools]
    return lambda w, g: [getattr(tool, name) for tool in w.tools]


def stiffness(given: Given) -> Stiffness:
    return Stiffness(given["force"].ravel(), given["order"][4:], given["order"][:5] * 0)


def written_cases(world: World, given: Given) -> Path:
    cases = LoadCases.of(given["nodal"][0], given["nodal"])
    shared_schema.write_load_cases(world.folder / "loads.h5", cases, "quad")
    return world.folder / "loads.h5"


def of_material(name: str, material: Material) -> dict[str, Callable[[World, Given], Any]]:
    """Calls of what every material has."""

    def energy(world: World, given: Given) -> Any:
        return material.energy(Invariants(given["force"][0], 3.0, 1 + given["force"][0]), ARRAYS)

    return {
        f"{name}.energy": energy,
        f"{name}.at_rest": lambda w, g: material.at_rest(),
        f"{name}.family_count": lambda w, g: material.family_count,
        f"{name}.lame_lambda": lambda w, g: material.lame_lambda,
        f"{name}.lame_mu": lambda w, g: material.lame_mu,
    }


CALLS: dict[str, Callable[[World, Given], Any]] = {
    "DatasetReader.ascending": lambda w, g: w.reader.ascending(),
    "DatasetReader.body": lambda w, g: w.reader.body,
    "DatasetReader.cell_type": lambda w, g: w.reader.cell_type,
    "DatasetReader.columns": lambda w, g: w.reader.columns("samples/force"),
    "DatasetReader.gathered": lambda w, g: w.reader.gathered(
        ["samples/force"], w.reader.ascending()
    ),
    "DatasetReader.has": lambda w, g: w.reader.has("samples/stable"),
    "DatasetReader.joined": lambda w, g: w.reader.joined(["samples/force", "failed/force"]),
    "DatasetReader.require_equilibria": lambda w, g: w.reader.require_equilibria(),
    "DatasetReader.shard": lambda w, g: w.reader.shard(w.manifest.shards[0]),
    "DatasetReader.unstable": lambda w, g: w.reader.unstable(),
    "Grid.forces_to_grid": lambda w, g: w.grid.forces_to_grid(g["nodal"]),
    "Grid.from_coordinates": lambda w, g: Grid.from_coordinates(g["coordinates"]),
    "Grid.in_a_row": lambda w, g: Grid.in_a_row(4, 2),
    "Grid.moved_by": lambda w, g: w.grid.moved_by(g["chosen"]),
    "Grid.of_nodes": lambda w, g: Grid.of_nodes(g["node at"]),
    "Grid.reordered": lambda w, g: w.grid.reordered(g["order"]),
    "Grid.to_grid": lambda w, g: w.grid.to_grid(g["nodal"]),
    "Grid.to_nodes": lambda w, g: w.grid.to_nodes(g["grid"]),
    "Grid.is_a_row": lambda w, g: w.grid.is_a_row,
    "Grid.mask": lambda w, g: w.grid.mask,
    "Grid.node_at": lambda w, g: w.grid.node_at,
    "Grid.nodes": lambda w, g: w.grid.nodes,
    "Grid.points_are_nodes": lambda w, g: w.grid.points_are_nodes,
    "Grid.shape": lambda w, g: w.grid.shape,
    "grid_of": lambda w, g: shared_schema.grid_of({"grid/node_at": g["node at"]}),
    "LoadCases.of": lambda w, g: LoadCases.of(g["nodal"][0], g["nodal"]),
    "LoadCases.load": lambda w, g: LoadCases.of(g["nodal"][0], g["nodal"]).load(1),
    "write_load_cases": lambda w, g: written_cases(w, g).name,
    "read_load_cases": lambda w, g: shared_schema.read_load_cases(written_cases(w, g)),
    "Manifest.case_digests": lambda w, g: w.manifest.case_digests,
    "Manifest.is_intact": lambda w, g: w.manifest.is_intact(),
    "Manifest.sealed": lambda w, g: w.manifest.sealed().spelled(),
    "Manifest.spelled": lambda w, g: w.manifest.spelled(),
    "Manifest.stiffness_checksum": lambda w, g: w.manifest.stiffness_checksum,
    "ShardEntry.lengths": lambda w, g: w.manifest.shards[0].lengths(w.manifest),
    **of_material("NeoHookean", MATERIAL),
    **of_material("OwnMaterial", OWN),
    "OwnMaterial.family_range": lambda w, g: OWN.family_range,
    "NeoHookean.volumetric_term": lambda w, g: MATERIAL.volumetric_term,
    "check_dataset": lambda w, g: shared_schema.check_dataset(w.nodal),
    "digest_of": lambda w, g: shared_schema.digest_of(g["content"]),
    "locate": lambda w, g: shared_schema.locate(g["inside"], g["coordinates"], g["cells"], "quad"),
    "read_manifest": lambda w, g: shared_schema.read_manifest(w.nodal).spelled(),
    "write_manifest": lambda w, g: shared_schema.write_manifest(w.folder, w.manifest).spelled(),
    "read_shard": lambda w, g: shared_schema.read_shard(w.nodal / "shard-00000.h5", "nodal"),
    "write_shard": lambda w, g: shared_schema.write_shard(
        w.folder / "shard.h5", "nodal", g["arrays"], "0" * 64, "quad"
    ),
    "write_stiffness": lambda w, g: shared_schema.write_stiffness(
        w.folder, stiffness(g), "0" * 64, "quad"
    ),
    "read_stiffness": lambda w, g: shared_schema.read_stiffness(w.folder),
    **{f"Tool.{name}": told(name) for name in (*GAPS, "dimension", "size", "inside")},
    "Mesh.moved": lambda w, g: w.mesh.moved((0.1, 0.0, 0.0)).gap(g["points"]),
    "Contact.nodes": lambda w, g: tools.Contact(g["force"], 0.0).nodes,
    "Contact.reaction": lambda w, g: tools.Contact(g["force"], 0.0).reaction,
    "contact_line": lambda w, g: tools.contact_line(tools.Contact(g["force"], 0.0), SI),
    "parse_tool": lambda w, g: tools.parse_tool("sphere:1,2,3:0.1", 3),
    "require_outside": lambda w, g: tools.require_outside(w.tools[0], g["points"], g["free"]),
}


@pytest.fixture(scope="module")
def worlds(tmp_path_factory: pytest.TempPathFactory) -> tuple[World, World]:
    folder = tmp_path_factory.mktemp("aliasing")
    return World(folder / "peaceful"), World(folder / "wild")


def test_every_public_name_is_called() -> None:
    """Those of a kind of tool are the names of all tools."""
    kinds = [
        getattr(package, name) for package in (shared_schema, tools) for name in package.__all__
    ]
    public = public_names([kind for kind in kinds if isinstance(kind, type)], ("shared_schema",))
    forms = {
        kind.__name__ for kind in kinds if isinstance(kind, type) and issubclass(kind, tools.Tool)
    }
    of_forms = {
        f"{form}.{name}" for form in forms for name in (*GAPS, "dimension", "size", "inside")
    }
    functions = public_functions(shared_schema) | public_functions(tools)
    assert public | functions == set(CALLS) | of_forms


@pytest.mark.parametrize("name", CALLS)
def test_call(name: str, worlds: tuple[World, World]) -> None:
    require_no_aliases(CALLS[name], worlds, arguments)
