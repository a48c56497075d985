"""Kernels as records: expressions, statements, and the printer of OpenCL C."""
