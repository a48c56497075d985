"""OpenCL devices: listing, self-test and selection, and building programs for them."""
