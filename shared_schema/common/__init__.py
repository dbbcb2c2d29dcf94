"""What both programs need and is no contract: errors, configuration, command line, files."""
