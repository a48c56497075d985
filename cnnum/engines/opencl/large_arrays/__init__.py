"""Large arrays: rows as vectors, and steps by strips of rows that stay in the cache."""
