"""The speed of a trigger wave's plane front, where one cell moves at a time."""

import numpy as np

from cnnum.errors import PhysicsError


def front_time(centre: float, ring: float, bias: float) -> float:
    """Return the time constants in which a plane front moves by a cell, along a row or column.

    Of x' = −x + centre f(x) + ring (eight neighbours' f) + bias, which is linear by pieces. Let
    p be centre + 2 ring (the cell and those beside it) and q 3 ring. A cell on its way from −1 to
    1, between a black cell and a white one, takes ln((bias + p − 1) / (bias − p + 1)) / (p − 1).
    Meanwhile the next one rises from its rest at bias − p − 2q, and then goes on to −1.

    Parameters
    ----------
    centre, ring, bias : float

    Raises
    ------
    PhysicsError
        If the front stands, or the next cell starts before the one behind it is through: then
        there is no such formula.
    """
    p, q = centre + 2.0 * ring, 3.0 * ring
    grow, start, goal = p - 1.0, bias - p - 2.0 * q, bias - p
    if not (grow > 0.0 and bias > grow and goal > -1.0 > start):
        raise PhysicsError(
            f"A front with centre {centre:g}, ring {ring:g} and bias {bias:g} does not move, or "
            "needs no neighbour: the bias must be between centre + 2 ring − 1 and that and 6 ring."
        )
    through = np.log((bias + grow) / (bias - grow)) / grow
    # behind: y = −bias/grow + (bias − grow)/grow · e^(grow t)
    # ahead: x' = −x − p + q (y − 1) + bias
    level = goal - q - q * bias / grow
    rising = q * (bias - grow) / grow / (grow + 1.0)
    falling = start - level - rising
    reached = level + rising * np.exp(grow * through) + falling * np.exp(-through)
    if reached > -1.0:
        raise PhysicsError(
            f"With centre {centre:g}, ring {ring:g} and bias {bias:g} two cells of a front move at "
            "a time: raise the centre and the bias by as much."
        )
    return float(through + np.log((goal - reached) / (goal + 1.0)))
