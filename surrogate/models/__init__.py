"""The kinds of model: configuration, initialisation from the data, predictive distribution."""
