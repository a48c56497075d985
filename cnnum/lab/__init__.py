"""Measurements: benchmarks, scores of the programs, and figures of the dissertation."""
