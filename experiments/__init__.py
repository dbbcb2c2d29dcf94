"""Experiments: the paper's tables and figures, studies beyond it, benchmarks, and GPU steps."""
