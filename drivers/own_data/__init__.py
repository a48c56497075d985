"""Files that others wrote: one CSV, NumPy or HDF5 file, with its layout named in a small TOML."""
