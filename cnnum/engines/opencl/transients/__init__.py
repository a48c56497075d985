"""Lowering of transients to statements: the drive of cells, their rates, and time steps."""
