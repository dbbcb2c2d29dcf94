"""One framework for all experiments: what one is, its record, the runner, the report."""
