"""What sums, products and roots come to, in whole numbers and in reals."""
