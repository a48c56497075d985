"""Sums, products and roots, in whole numbers and in reals."""
