"""Load families: each draws load cases as a pure function of seed and sample number."""

from shared_schema.loads.drawn_load import DrawnLoads
from shared_schema.loads.family import LoadableNodes, LoadCase, LoadFamily, generator, load_family
from shared_schema.loads.together import Load, LoadsTogether, Recorded, act_between

__all__ = [
    "DrawnLoads",
    "Load",
    "LoadCase",
    "LoadFamily",
    "LoadableNodes",
    "LoadsTogether",
    "Recorded",
    "act_between",
    "generator",
    "load_family",
]
