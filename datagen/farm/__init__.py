"""The farm: all ranks solve the load cases of a dataset; killed and resumed at any time."""
