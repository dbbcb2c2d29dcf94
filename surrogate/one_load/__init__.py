"""Prediction under one load at a time, without PyTorch: NumPy, and loops that Numba compiles."""

from surrogate.one_load.backend import InputsByPyTorch, OneLoad, in_numpy

__all__ = ["InputsByPyTorch", "OneLoad", "in_numpy"]
