"""Prediction under one load at a time, without PyTorch: NumPy, and loops that Numba compiles."""
