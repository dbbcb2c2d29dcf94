"""Unit cells with holes under a macroscopic stretch: the family of PLAID's 2D_MultiScHypEl."""
