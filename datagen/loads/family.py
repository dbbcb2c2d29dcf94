"""Base class of load families, and their names in case files.

A case file names a shipped family, or a user's class as ``family: path/to/file.py:ClassName``; the
path is relative to the case file.
"""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
)

from datagen.loads.own_family import import_class
from datagen.mesh.regions import Region
from datagen.quantities import Magnitude
from shared_schema.common.configuration import Frozen, first_problem

SHIPPED = {
    "random_node": "datagen.loads.random_node:RandomNode",
    "random_nodes": "datagen.loads.random_nodes:RandomNodes",
    "each_node": "datagen.loads.each_node:EachNode",
    "given": "datagen.loads.given:GivenLoads",
    "sweep": "datagen.loads.sweep:Sweep",
    "traction": "datagen.loads.traction:Traction",
    "traction_patch": "datagen.loads.traction_patch:TractionPatch",
}


def _ascending(value: tuple[float, float]) -> tuple[float, float]:
    """Return (low, high); ValueError unless low < high."""
    if value[0] >= value[1]:
        raise ValueError("expected [low, high] with low < high")
    return value


ForceRange = Annotated[tuple[Magnitude, Magnitude], AfterValidator(_ascending)]


@dataclass(frozen=True)
class LoadableNodes:
    """Nodes that a family may load, with the mesh that they belong to.

    Attributes
    ----------
    nodes : array of int, (n_loadable,)
        Numbers of the loadable nodes, ascending.
    coordinates : array, (n_nodes, d)
        Positions of all nodes of the mesh, in m.
    cells : array of int, (n_cells, n_corners)
        Node numbers of every cell of the mesh, in VTK order.
    cell_type : str
        meshio's name.
    """

    nodes: NDArray[np.int64]
    coordinates: NDArray[np.float64]
    cells: NDArray[np.int64]
    cell_type: str

    def __len__(self) -> int:
        return len(self.nodes)

    @property
    def dimension(self) -> int:
        """Number of space dimensions d."""
        return int(self.coordinates.shape[1])

    def require_components(self, key: str, vector: tuple[float, ...]) -> None:
        """Raise ValueError unless a vector of the case has d components."""
        if len(vector) != self.dimension:
            raise ValueError(f"key '{key}' = {vector}: expected {self.dimension} components")


@dataclass(frozen=True)
class LoadCase:
    """The load of one sample.

    Attributes
    ----------
    nodes : array of int, (n_loads,)
        Numbers of the loaded nodes, each once.
    forces : array, (n_loads, d)
        Force vector at each of them, in N.
    """

    nodes: NDArray[np.int64]
    forces: NDArray[np.float64]


class LoadFamily(Frozen, ABC):
    """A family of load cases; its attributes are the keys of a case's ``load`` section.

    Attributes
    ----------
    family : str
        Name of the family in the case file.
    region : Region
        Region of the loadable nodes; none of them may be clamped.
    family_sha256 : str, optional
        Checksum of the file of a user's own family. It is filled in when a case is read, so that a
        dataset belongs to one version of the file.
    """

    family: str
    region: Region
    family_sha256: str | None = Field(None, pattern=r"^[0-9a-f]{64}$")

    @model_serializer(mode="wrap")
    def _without_absent_checksum(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out no checksum, so that cases with shipped families keep their digest."""
        content: dict[str, Any] = plain(self)
        if self.family_sha256 is None:
            del content["family_sha256"]
        return content

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError, which names the key, if the family does not fit the mesh."""

    @abstractmethod
    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the load of one sample, as a pure function of the arguments.

        Parameters
        ----------
        number : int
            Sample number.
        seed : int
            Seed of the dataset.
        loadable : LoadableNodes
            Nodes of the region.
        """

    @abstractmethod
    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Largest number of loaded nodes of a sample."""


def generator(seed: int, number: int) -> np.random.Generator:
    """Generator of a sample's random numbers: the same on every rank, restart and order of work."""
    return np.random.default_rng([seed, number])


def load_family(content: dict[str, Any], folder: Path | None = None) -> LoadFamily:
    """Build the family that the ``load`` section of a case names.

    Parameters
    ----------
    content : dict
        The section.
    folder : Path, optional
        Folder of the case file. Without one only shipped families are allowed, and nothing else is
        imported.

    Raises
    ------
    ValueError
        If there is no such family, its file cannot be imported or has another checksum, or one of
        the keys is wrong.
    """
    name = content.get("family")
    if not isinstance(name, str):
        raise ValueError(f"expected 'family', one of {', '.join(SHIPPED)} or FILE.py:ClassName")
    if name in SHIPPED:
        if content.get("family_sha256") is not None:
            raise ValueError(f"key 'family_sha256': load family '{name}' is no file")
        if folder is not None and isinstance(content.get("file"), str):
            content = {**content, "file": str(folder / content["file"])}
        place, _, class_name = SHIPPED[name].rpartition(":")
        family = getattr(importlib.import_module(place), class_name)
    else:
        family, digest = _own(name, folder)
        if content.get("family_sha256") not in (None, digest):
            raise ValueError(
                f"load family '{name}': key 'family_sha256' = {content['family_sha256']!r}, "
                f"the file has {digest}"
            )
        content = {**content, "family_sha256": digest}
    try:
        built: LoadFamily = family.model_validate(content)
    except ValidationError as error:
        raise ValueError(f"{first_problem(error)} (load family '{name}')") from None
    return built


def _own(name: str, folder: Path | None) -> tuple[type[LoadFamily], str]:
    """Import ``FILE.py:ClassName``, with the checksum of the file; ValueError if it is unfit."""
    file, _, class_name = name.rpartition(":")
    if not (file.endswith(".py") and class_name.isidentifier()):
        raise ValueError(
            f"load family '{name}': expected one of {', '.join(SHIPPED)} or FILE.py:ClassName"
        )
    if folder is None:
        raise ValueError(f"load family '{name}': own families are read with a case file only")
    try:
        family, digest = import_class(folder / file, class_name)
    except ValueError as error:
        raise ValueError(f"load family '{name}': {error}") from None
    if not (isinstance(family, type) and issubclass(family, LoadFamily)):
        raise ValueError(f"load family '{name}': expected a subclass of LoadFamily")
    return family, digest
