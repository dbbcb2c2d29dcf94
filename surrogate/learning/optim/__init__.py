"""Optimisers, learning-rate schedules, weight averages, early stopping."""
