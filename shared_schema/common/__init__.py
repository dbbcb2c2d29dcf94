"""Code of both programs beside the contract: errors, configuration, command line, loads, files."""
