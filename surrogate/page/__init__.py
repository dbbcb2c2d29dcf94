"""A page to drag loads on: one HTML file with the body, the network and the code that runs it."""
