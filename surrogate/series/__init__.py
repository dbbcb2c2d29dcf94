"""Series of the displacement in the load."""
