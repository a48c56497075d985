"""Clocks, counts and paces of frames."""
