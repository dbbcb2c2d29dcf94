"""A case: its configuration, and the body that is built from it."""
