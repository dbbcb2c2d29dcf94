"""Bodies and what acts on them: facets, groups, loads of a command, stresses."""
