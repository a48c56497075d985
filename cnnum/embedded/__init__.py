"""The same program in whole numbers: formats, an emulator that is exact to the bit, and C99.

The way of a program: its schedule → `measuring` (the range of every value, in reals) → `sizes` (a
format for each) → `lowering` (statements on whole numbers, each with an interval that it cannot
leave) → `emulator` (NumPy), or the printers (C99 and OpenCL C).
"""
