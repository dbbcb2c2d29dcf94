"""Measures, tables, claims and figures that the studies are composed of."""
