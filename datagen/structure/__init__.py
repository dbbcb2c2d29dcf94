"""Steps from one dataset to the next: nodal fields onto grids, noise."""
