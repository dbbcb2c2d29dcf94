"""The geometries that a case file can name, told apart by the key ``kind`` of its ``mesh``."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from datagen.mesh.box import Box
from datagen.mesh.lshape import LShape
from datagen.mesh.mesh_file import MeshFile

Geometry = Annotated[Box | LShape | MeshFile, Field(discriminator="kind")]
