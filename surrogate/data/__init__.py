"""Datasets in memory: samples, geometry, and the samples' place during a training."""
