"""What the file of a user's own load family imports."""

from shared_schema.loads import (
    DrawnLoads,
    LoadableNodes,
    LoadCase,
    LoadFamily,
    generator,
    load_family,
)

__all__ = ["DrawnLoads", "LoadCase", "LoadFamily", "LoadableNodes", "generator", "load_family"]
