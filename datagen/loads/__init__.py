"""Families of load cases: pure functions of a seed and a sample number, one file each."""

from datagen.loads.family import LoadableNodes, LoadCase, LoadFamily, generator, load_family

__all__ = ["LoadCase", "LoadFamily", "LoadableNodes", "generator", "load_family"]
