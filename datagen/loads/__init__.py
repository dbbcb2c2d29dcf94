"""Load families, one a file: each draws load cases as a pure function of seed and sample number."""

from datagen.loads.drawn_load import DrawnLoads
from datagen.loads.family import LoadableNodes, LoadCase, LoadFamily, generator, load_family
from datagen.loads.together import Load, LoadsTogether, Recorded, act_between

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
