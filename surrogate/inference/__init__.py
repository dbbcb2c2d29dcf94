"""Prediction with a trained network, and its export to a file of its own."""
