"""Numbers that stand for words inside compiled functions."""

import numpy as np

KNOWN, FIXED, ADAPTIVE, CHEBYSHEV = range(4)
"""How a transient is brought to its end."""

CLAMP, IDENTITY, TANH, SIGN, EXPRESSION = range(5)
"""Output functions."""

TAKE_STATE, TAKE_NUMBER = 0, 1
NEGATE, EXP, FABS, LOG, SQRT, TANH_OF, REAL = range(2, 9)
ADD, SUBTRACT, MULTIPLY, DIVIDE, FMAX, FMIN, POW = range(9, 16)
LESS, NOT_MORE, MORE, NOT_LESS, EQUAL, OTHER = range(16, 22)
WITHIN, PICK = range(22, 24)
"""Of an output function without a compiled form: pushes on a stack, and operations with one
operand, with two, and with three."""

FEEDBACK, CONTROL, LATE_FEEDBACK, LATE_CONTROL, MOVING, STILL = range(6)
"""Kinds of taps: A, B, delayed A and B; nonlinear ones that follow the states, or inputs alone."""

STATE, MOVED, OUTPUT, INPUT, DRIVE, PACE, PAST, LATER, SLOPES = range(9)
"""Maps of a frame at work: x; x at a stage; y = f(x); u; the drive of the cells; 1/τ, or 0 where a
cell is held; outputs a delay ago; the sum of delayed inputs when the delay is over; and from SLOPES
on one dx/dt a stage, then the outputs of the last steps."""

NOTHING = -1
"""Centre of a nonlinear coupling that reads only the neighbour."""

EARLIER = PAST
"""Of Chebyshev's stages, which know no delay: the state two stages ago."""

MOVE, SLOPE, JUDGE, CHANGE, ACCEPT, STEP = range(6)
"""Phases of a step."""

WEIGHTS, TIMES, ERRORS, CARRIED, STAGES = range(5)
"""Rows of a tableau: b, c, b − b̂, the part of the last stage's move carried to the end, and
from STAGES on the rows of a; then the truncation error's."""

NONE, AT_REST = np.int64(0), np.int64(-1)
"""No stage or step in particular, and the number of no step: outputs a delay ago are those of now.
Not literals, as functions are compiled for each of those."""

LARGEST_EXPONENT, SMALLEST_RATE, LOST = 80.0, 1e-30, 1e30
"""Limits within which a growth is a number of single precision."""
