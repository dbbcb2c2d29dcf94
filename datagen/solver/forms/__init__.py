"""Strain energy of a body and its derivatives, as forms that FFCx compiles."""
