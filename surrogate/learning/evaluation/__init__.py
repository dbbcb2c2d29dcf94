"""What is asked about runs: evaluation, comparison, and a report as a page."""
