"""The keys of configurations, from their models: type, unit, default and meaning of each."""
