"""Prediction under one load at a time, without PyTorch: NumPy, and loops that Numba compiles."""

from surrogate.one_load.backend import InputsByPyTorch, OneLoad, in_numpy
from surrogate.one_load.response_alone import ResponseAlone

__all__ = ["InputsByPyTorch", "OneLoad", "ResponseAlone", "in_numpy"]
