"""Studies: one module for each table or figure family of the paper, and their catalogue."""
