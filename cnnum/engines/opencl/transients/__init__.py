"""Templates' transients become statements: what drives cells, how they change, and steps."""
