"""A virtual array: a simulated one behind a pseudo-terminal, in any protocol, with faults."""
