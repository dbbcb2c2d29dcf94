"""Datasets in the PLAID format: pyplaid's own writer and reader, in an environment of their own."""
