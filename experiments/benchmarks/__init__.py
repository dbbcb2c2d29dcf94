"""Benchmarks, one file each: JSON results, and the page made from them."""
