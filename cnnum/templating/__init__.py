"""Templates: the numbers of a cell, its couplings and boundary, their files, the library and its checks."""
