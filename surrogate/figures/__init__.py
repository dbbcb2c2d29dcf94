"""Figures and report page of a run."""
