"""Studies beyond the paper: loads on any nodes, mechanics inside networks, their uncertainty."""
