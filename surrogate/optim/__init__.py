"""What changes the weights: optimisers, schedules, weight averages, early stopping."""
