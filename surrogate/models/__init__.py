"""The kinds of model: each with its configuration, its start from the data, its distribution."""
