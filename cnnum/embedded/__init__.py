"""The same program in whole numbers: formats, an emulator that is exact to the bit, and C99.

The way of a program: its schedule → `measuring` → `sizes` → `lowering` → `emulator`, or the
printers. `measuring` finds the range of every value, in reals. `sizes` finds a format for each.
`lowering` makes statements on whole numbers, each with an interval that it cannot leave. `emulator`
runs them in NumPy, the printers write C99 and OpenCL C.
"""
