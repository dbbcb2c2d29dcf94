"""A page on which one drags a load: one HTML file with body, network and all that runs it."""
