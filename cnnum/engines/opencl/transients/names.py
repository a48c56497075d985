"""The names that the statements of transients share: arrays, and variables of a cell or a frame."""

from cnnum import kernels as ir

X, Y, XP, YD, U = ir.names("x y xp yd u")
"""States, stacked by layers; padded outputs, states, outputs a delay ago, and inputs."""

W, LATER = ir.names("w later")
"""The drive of the cells, and its change when a delay is over."""

SUM, NOW, RATE, PART = ir.names("sum now rate part")
"""Of a cell: a sum and a value at hand, dx/dt, and a part of a sum."""

XS = ir.Name("xs")
"""The states at a step's stages, in the end at its end."""

H, TIME, STEPS, RUNNING = ir.names("h time steps running")
"""A step's length, time and steps since the start, and whether a frame takes another step."""

CHANGE, SETTLED, STILL = ir.names("change settled still")
"""The largest rate, in units of the tolerance; whether, and for how many steps, nothing changes."""

LARGEST = ir.Name("largest")
"""The largest number that the rounding of a closed form goes by."""


def zeros(*variables: ir.Name) -> tuple[tuple[ir.Name, ir.Expression], ...]:
    """Return variables of a declaration, whose first values are 0."""
    return tuple((name, ir.ZERO) for name in variables)


def rates_of(stage: int) -> ir.Name:
    """Return the array of a stage's rates."""
    return ir.Name(f"k{stage}")
