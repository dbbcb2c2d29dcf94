"""A run: its configuration, its folder, and the split of its training samples."""
