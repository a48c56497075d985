"""The OpenCL engine: a plan becomes one kernel, generated for its templates and its array."""
