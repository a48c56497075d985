"""Guards for data from outside: names, expressions, memory and files."""
