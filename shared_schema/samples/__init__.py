"""The samples of a nodal dataset that is being made: shards, results, the state of a killed run."""
