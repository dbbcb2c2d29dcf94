"""Motion: inertia, time steps, and bodies that move."""
