"""Load cases of a file (`shared_schema.load_cases`)."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from shared_schema.common.checksum import sha256
from shared_schema.common.errors import InputError
from shared_schema.load_cases import LoadCases, read_load_cases
from shared_schema.loads.family import LoadableNodes, LoadCase, LoadFamily

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
