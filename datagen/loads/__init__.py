"""Families of load cases: pure functions of a seed and a sample number, one file each."""

from datagen.loads.family import LoadCase, LoadFamily, load_family

__all__ = ["LoadCase", "LoadFamily", "load_family"]
