"""Arrays that are handed out without a copy, and so are not to be written to."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Kind = TypeVar("Kind", bound=np.generic)


def read_only(values: NDArray[Kind]) -> NDArray[Kind]:
    """Return a view of the same numbers; writing to it raises ValueError."""
    view = values.view()
    view.setflags(write=False)
    return view


def hold_read_only(record: Any) -> None:
    """Let a frozen dataclass hold its arrays, and those in its mappings, as such views."""
    for each in fields(record):
        value = getattr(record, each.name)
        if isinstance(value, np.ndarray):
            object.__setattr__(record, each.name, read_only(value))
        elif isinstance(value, dict):
            views = {
                name: read_only(one) if isinstance(one, np.ndarray) else one
                for name, one in value.items()
            }
            object.__setattr__(record, each.name, views)
