"""A dataset as a benchmark for others: inputs and answers apart, with a card, in two layouts."""
