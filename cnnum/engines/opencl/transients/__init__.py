"""Templates' transients become statements: the drive of cells, their rates, and steps."""
