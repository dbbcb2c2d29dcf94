"""Every load case of a dataset solved by all ranks, killed and resumed at any time."""
