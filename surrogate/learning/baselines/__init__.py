"""Baselines for the networks: a linear map, and orthogonal modes with a regression."""
