"""An active contour that follows the outline of the body on which it started.

    seed             where a contact begins: the taxel with the largest pressure
    force            taxels in contact draw the cells above them to black, the others to white
    front            contour_wave, for the time of a frame, from its state after the last frame
    contour          the cells at the rim of the region

The region can grow and shrink only at its front, by one cell per `CELL_TIME`. It therefore stays
with its body when another one touches elsewhere, and follows it as long as the body is no faster
than the front. A faulty frame moves it by no more than a front moves in one frame.

References
----------
Rekeczky & Chua, J. VLSI Signal Processing 23 (1999) 373: active contours by propagating fronts;
Vilariño, Brea, Cabello & Pardo, Pattern Recognition Letters 19 (1998) 721: pixel-level snakes.
"""

from collections.abc import Mapping

import numpy as np

from cnnum.errors import PhysicsError
from cnnum.graph.nodes import RunSpec
from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, minimum, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.transients import shift, transient
from cnnum.templates.tactile.cover_model.fields import DEPTH, READS, Carries
from cnnum.templates.tactile.shared.loads import PUSH, loads_of
from cnnum.templates.tactile.shared.pressure import pressed_of
from cnnum.templating.library import get_template


def front_time(centre: float, ring: float, bias: float) -> float:
    """Return the time in which a plane front moves by one cell along a row or column.

    The array is x' = −x + centre f(x) + ring (f of the eight neighbours) + bias, which is piecewise
    linear. Let p = centre + 2 ring (the cell and the two beside it) and q = 3 ring. A cell between
    a black and a white one takes ln((bias + p − 1) / (bias − p + 1)) / (p − 1) to go from −1 to 1.
    Meanwhile the next one rises from its rest at bias − p − 2q, and then goes on to −1.

    Parameters
    ----------
    centre, ring, bias : float

    Raises
    ------
    PhysicsError
        If the front does not move, or the next cell starts before the previous one has finished,
        so that the formula does not hold.
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


SHARE = 0.1
"""Share of the peak pressure from which a taxel counts as touched, as in `contact`."""

CENTRE, RING, BIAS = 4.0, 0.25, 4.75
"""Weights of `contour_wave`."""

CELL_TIME = front_time(CENTRE, RING, BIAS)
"""Time in which a front moves by one cell, in time constants."""

AT_REST = CENTRE + 8.0 * RING - BIAS
"""Magnitude of the state of a cell that a front is approaching. Cells far from any front have
larger states, and would react late."""


@program
def active_contour(
    frame: FrameFields,
    *,
    push: float = PUSH,
    speed: float = 100.0,
    share: float = SHARE,
    depth: float = DEPTH,
    reads: Carries = READS,
) -> Mapping[str, Field]:
    """Follow the outline of a body by an active contour.

    Parameters
    ----------
    frame : FrameFields
        Strain, stress or calibrated signals, in any unit, as for `contact`.
    push : float
        −1 for strain and stress, which count tension as positive; +1 for signals and counts that
        rise under a push.
    speed : float, cells/s
        Speed of the front, along rows and columns.
    share, depth, reads : float, float, "strain", "stress" or "force"
        As for `contact`.

    Returns
    -------
    mapping
        `contour` (logic map: the cells at the rim of the region), `contour_inside` (logic map),
        `contour_area` (cells), `contour_row`, `contour_column` (centroid, cells; after the contact,
        its last value), `contour_holds` (flag: there is a region), `contour_rests` (flag: its front
        has stopped).

    Raises
    ------
    ProgramError
        If a parameter is out of range.
    PhysicsError
        If the depth is out of range.
    UnknownNameError
        If `reads` is unknown.
    """
    refuse_outside(speed=(speed, 1e-3, 1e6))
    loads = frame.once(loads_of, push=push)
    touched = pressed_of(loads, share, depth, reads, 1.0)
    memory, held = frame.memory("front"), frame.memory("region", logic=True)
    front = where(held.value.any(), minimum(maximum(memory.value, -AT_REST), AT_REST), -AT_REST)
    peak = touched.weight.max()
    seed = ~held.value.any() & touched.touched & (touched.weight >= peak) & (peak > 0.0)
    run = transient(
        get_template("contour_wave"),
        state=where(seed, AT_REST, front),
        bias=where(touched.touched, 0.0, -2.0 * BIAS),
        spec=RunSpec(duration=speed * CELL_TIME / frame.rate),
    )
    state = run.states[0]
    inside = (state > 0.0) & loads.contact
    memory.store(where(loads.contact, state, -AT_REST))
    held.store(inside)
    holds = inside.any()
    row, column = (
        frame.memory(f"last {name}", scalar=True).hold(place, holds)
        for name, place in zip(
            ("row", "column"), frame.centroid(where(inside, 1.0, 0.0)), strict=True
        )
    )
    changed_side = (_next_to(inside) & touched.touched & ~inside) | (inside & ~touched.touched)
    return {
        "contour": inside & _next_to(~inside),
        "contour_inside": inside,
        "contour_area": inside.count(),
        "contour_row": row,
        "contour_column": column,
        "contour_holds": holds,
        "contour_rests": holds & ~changed_side.any(),
    }


def _next_to(region: Field) -> Field:
    """Return the cells that have one of a region among their eight neighbours."""
    rows, cols = region.graph.shape
    field = region & ~region
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            if (down or right) and abs(down) < rows and abs(right) < cols:
                field = field | shift(region, down, right)
    return field
