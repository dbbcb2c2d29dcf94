"""Mechanics inside networks: the linear response of the undeformed body."""
