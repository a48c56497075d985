"""Runs of single templates: arguments, results, and runs prepared for repeated use."""
