"""What is asked about runs: evaluation, comparison, learning curve, and a report as a page."""
