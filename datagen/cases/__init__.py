"""Cases: their configuration, and the body that is built from it."""
