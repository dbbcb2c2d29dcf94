"""Training: loop, checkpoints, several processes, CUDA graphs, compilation."""
