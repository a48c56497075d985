"""A schedule becomes the statements of kernels, and those become their text."""
