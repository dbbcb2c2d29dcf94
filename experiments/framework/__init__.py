"""Machinery of the studies: scales, resources, timing, records and the report."""
