"""The U-Net, and networks that map fields in SI units, on the grid and at the nodes."""
