"""What a body is made of: mesh, supports and grid, elements, Young's moduli."""
