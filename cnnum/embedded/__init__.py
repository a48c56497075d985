"""Programs in fixed-point arithmetic: formats, a bit-exact emulator, and C99.

A program passes through its schedule → `measuring` → `sizes` → `lowering` → `emulator` or the
printers. `measuring` finds the range of every value in floating point, and `sizes` a format for
each. `lowering` produces integer statements, each with an interval that it cannot leave. `emulator`
runs them in NumPy; the printers write C99 and OpenCL C.
"""
