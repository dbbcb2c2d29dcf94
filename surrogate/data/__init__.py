"""Datasets in memory: samples, geometry, and where the samples live during training."""
