"""What samples add to a body: data, networks, training, runs, evaluation, and their predictions."""
