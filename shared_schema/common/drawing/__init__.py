"""Figures of both programs: one style, and meshes in two and three dimensions."""
