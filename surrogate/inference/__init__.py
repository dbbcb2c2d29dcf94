"""Prediction with a trained network, and export of the network to a single file."""
