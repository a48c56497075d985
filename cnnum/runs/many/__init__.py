"""Runs of many templates at once."""
