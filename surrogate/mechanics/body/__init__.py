"""A body and its loads: mesh, supports, elements, materials."""
