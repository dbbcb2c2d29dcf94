"""Before a training: a first configuration for a dataset, and what its training takes."""
