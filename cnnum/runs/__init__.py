"""Runs of single templates: their arguments, their results, and runs that are prepared once."""
