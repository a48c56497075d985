"""Errors of the tactile programs, and bounds on them."""
