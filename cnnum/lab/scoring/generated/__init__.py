"""Generated scenes: drawn from a seed, simulated, and run in batches."""
