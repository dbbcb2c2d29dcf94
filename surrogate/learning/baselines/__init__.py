"""Baselines for the networks: a linear map, and orthogonal modes with a regression."""

from surrogate.learning.baselines.linear_map import LinearMap
from surrogate.learning.baselines.pod import GaussianProcessConfig, PODNetwork, RidgeConfig

__all__ = ["GaussianProcessConfig", "LinearMap", "PODNetwork", "RidgeConfig"]
