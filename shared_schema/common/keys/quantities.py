"""Types of the numbers in a case file, with bounds that any sensible case keeps."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

LARGEST_SEED = 2**63 - 1
LARGEST_MAGNITUDE = 1e12
LARGEST_LENGTH = 1e9

Length = Annotated[float, Field(ge=-LARGEST_LENGTH, le=LARGEST_LENGTH)]  # m, also a coordinate
Size = Annotated[float, Field(ge=1e-9, le=1e9)]  # m, of a body or a part of it
Magnitude = Annotated[float, Field(ge=-LARGEST_MAGNITUDE, le=LARGEST_MAGNITUDE)]  # N, or Pa
Count = Annotated[int, Field(gt=0, le=10**9)]
Seed = Annotated[int, Field(ge=0, le=LARGEST_SEED)]
