"""Baselines for the U-Net: a linear map, and proper orthogonal decomposition."""
