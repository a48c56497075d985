"""Large arrays: rows stored as vectors, and time steps on strips of rows that fit the cache."""
