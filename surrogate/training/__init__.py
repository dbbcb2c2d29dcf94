"""Training: loop, checkpoints, data parallelism, CUDA graphs, compilation."""
