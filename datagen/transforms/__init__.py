"""Steps from one dataset to the next: nodal fields on grids, noise."""
