"""Which engines change a program before they run it."""

FUSING = frozenset({"opencl", "numba"})
"""Engines whose plans fuse linear operations; the reference runs every one of them, so that it
can check the others."""
