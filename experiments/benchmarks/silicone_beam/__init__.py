"""Positions of markers on a real beam of silicone, and how they are read from its recordings."""
