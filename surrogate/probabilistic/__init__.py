"""Random weights and outputs: posteriors, Flipout, dropout, ensembles, likelihoods, passes."""
