"""Families of forces at nodes: random ones as in the paper, sweeps, and those of a file."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, field_validator, model_validator

from shared_schema.common.errors import InputError
from shared_schema.common.files import sha256
from shared_schema.common.units import Magnitude
from shared_schema.load_cases import LoadCases, read_load_cases
from shared_schema.loads.family import (
    CountRange,
    ForceRange,
    LoadableNodes,
    LoadCase,
    LoadFamily,
    generator,
)


class RandomNode(LoadFamily):
    """One node per sample, each component of its force drawn from U(low, high).

    Attributes
    ----------
    range : tuple of 2 floats
        (low, high) of each force component, in N.
    balanced : bool
        If true, the nodes take turns, so that each is loaded equally often; otherwise the node is
        drawn uniformly.
    """

    range: ForceRange
    balanced: bool = True

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Choose the node, then draw its force."""
        random = generator(seed, number)
        count = len(loadable)
        chosen = number % count if self.balanced else int(random.integers(count))
        force = random.uniform(*self.range, size=(1, loadable.dimension))
        return LoadCase(loadable.nodes[[chosen]], force)

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of loaded nodes: one."""
        return 1


class RandomNodes(LoadFamily):
    """Several different nodes per sample, each component of their forces drawn from U(low, high).

    Attributes
    ----------
    range : tuple of 2 floats
        (low, high) of each force component, in N.
    count : tuple of 2 ints
        Smallest and largest number of nodes of a sample; the number is drawn uniformly.
    """

    range: ForceRange
    count: CountRange = (2, 5)

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError if a sample can need more nodes than the region has."""
        if len(loadable) < self.count[1]:
            raise ValueError(f"key 'count' = {self.count}: the region has {len(loadable)} nodes")

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the number of nodes, then the nodes, then their forces."""
        random = generator(seed, number)
        count = int(random.integers(self.count[0], self.count[1] + 1))
        chosen = random.choice(len(loadable), size=count, replace=False)
        forces = random.uniform(*self.range, size=(count, loadable.dimension))
        return LoadCase(loadable.nodes[chosen], forces)

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Largest number of loaded nodes."""
        return self.count[1]


class EachNode(LoadFamily):
    """One node per sample under a given force; the nodes take turns in the order of coordinates.

    With as many samples as nodes each node is loaded once, as in the paper's study of loads away
    from the training nodes (1.5 N on each node of the free edge).

    Attributes
    ----------
    force : tuple of d floats
        Force vector in N.
    """

    force: tuple[Magnitude, ...] = Field(min_length=2, max_length=3)

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless the force has d components."""
        loadable.require_components("force", self.force)

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Load the next node: order by x, then y, then z, each from high to low."""
        size = np.ptp(loadable.coordinates, axis=0).max()
        places = (loadable.coordinates[loadable.nodes] / size).round(9)  # equal ones tie
        order = np.lexsort(-places.T[::-1])
        node = loadable.nodes[order[number % len(loadable)]]
        return LoadCase(np.array([node]), np.array([self.force]))

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of loaded nodes: one."""
        return 1


class Sweep(LoadFamily):
    """Magnitudes in equal steps from low to high, both included: sample i has the i-th magnitude.

    The paper's sweeps are −8…8 N, −6…6 N and −4…4 N.

    Attributes
    ----------
    direction : tuple of d floats
        Direction of the force, of any length but zero.
    range : tuple of 2 floats
        (low, high) of the magnitude, in N; negative magnitudes point against the direction.
    steps : int
        Number of magnitudes; sample number `steps` starts again at low.
    """

    direction: tuple[Magnitude, ...] = Field(min_length=2, max_length=3)
    range: ForceRange
    steps: int = Field(gt=1, le=10**6)

    @field_validator("direction")
    @classmethod
    def _has_length(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if not any(value):
            raise ValueError("expected a vector other than zero")
        return value

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless the direction has d components and the region is one node."""
        loadable.require_components("direction", self.direction)
        if len(loadable) != 1:
            raise ValueError(f"key 'region': has {len(loadable)} nodes, expected one to sweep at")

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Load the node with the next magnitude."""
        magnitude = np.linspace(*self.range, self.steps)[number % self.steps]
        direction = np.asarray(self.direction) / np.linalg.norm(self.direction)
        return LoadCase(loadable.nodes, magnitude * direction[None])

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of loaded nodes: one."""
        return 1


SAME_PLACE = 1e-6  # of the size of the body


class GivenLoads(LoadFamily):
    """The load cases of a file, in its order.

    Attributes
    ----------
    file : str, optional
        Path of the file. A dataset does not keep it, only the checksum.
    file_sha256 : str
        Checksum of the file, filled in when a case is read.
    """

    file: str | None = Field(None, exclude=True)
    file_sha256: str = Field(pattern=r"^[0-9a-f]{64}$")

    @model_validator(mode="before")
    @classmethod
    def _with_checksum(cls, content: Any) -> Any:
        if not isinstance(content, dict) or content.get("file") is None:
            return content
        path = Path(str(content["file"]))
        if not path.is_file():
            raise ValueError(f"key 'file' = '{path}': no such file")
        digest = sha256(path)
        if content.get("file_sha256") not in (None, digest):
            raise ValueError(f"key 'file_sha256': '{path}' has {digest}")
        return {**content, "file_sha256": digest}

    @cached_property
    def cases(self) -> LoadCases:
        """The load cases; ValueError if the file is not there or damaged."""
        if self.file is None:
            raise ValueError("key 'file' is missing: a dataset does not keep its file of loads")
        try:
            return read_load_cases(Path(self.file))
        except InputError as error:
            raise ValueError(str(error)) from None

    @property
    def acts_between(self) -> bool:
        """True if the file has forces between the nodes."""
        return self.cases.between is not None

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless the file is of this mesh."""
        ours, theirs = loadable.coordinates, self.cases.coordinates
        size = np.ptp(ours, axis=0).max()
        if ours.shape != theirs.shape or np.abs(ours - theirs).max() > SAME_PLACE * size:
            raise ValueError(f"'{self.file}': its loads are for another mesh")
        between, points = self.cases.between, loadable.points
        if between is not None and (points is None or between.shape[1] != points.between):
            raise ValueError(f"'{self.file}': its forces between the nodes are for other elements")

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Take the load case of that number."""
        if number >= len(self.cases):
            raise ValueError(f"'{self.file}' has {len(self.cases)} load cases")
        between = None if self.cases.between is None else self.cases.between[number]
        return LoadCase(*self.cases.load(number), between=between)

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Largest number of loaded nodes of a load case."""
        return int(self.cases.nodes.shape[1])
