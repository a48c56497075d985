"""OpenCL devices: a list of them, which of them work, and programs built for them."""
