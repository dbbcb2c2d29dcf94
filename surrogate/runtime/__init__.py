"""The machine that computes: devices, seeds, limits of time, CUDA graphs, tensors in files."""
