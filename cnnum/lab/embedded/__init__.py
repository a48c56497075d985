"""Costs of programs on a microcontroller, and their errors: exports, counts, event scores."""
