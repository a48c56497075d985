"""Templates: numbers, couplings, boundaries and outputs; their files, library and checks."""
