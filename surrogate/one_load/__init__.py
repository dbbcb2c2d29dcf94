"""Prediction under one load at a time, without PyTorch: NumPy, and loops that Numba compiles."""

from surrogate.one_load.backend import OneLoad, in_numpy

__all__ = ["OneLoad", "in_numpy"]
