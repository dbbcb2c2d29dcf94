"""The U-Net, and networks between fields in SI units on the grid and at the nodes."""
