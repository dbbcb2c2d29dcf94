"""Errors of predictions against the finite elements; nothing is drawn here."""
