"""Solids of finite elements: shape functions, materials, energy, internal forces, tangent."""
