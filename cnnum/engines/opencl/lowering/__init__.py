"""Lowering of a schedule to kernel statements, and of those to source code."""
