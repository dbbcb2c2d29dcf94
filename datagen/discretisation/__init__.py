"""Finite elements: their kinds, unknowns and quadrature, and the loop over the cells in C."""

from datagen.discretisation.element import ELEMENTS

__all__ = ["ELEMENTS"]
