"""Tactile flow: how fast the pattern of a load moves over the skin, and how its area spreads.

    low-pass         slow_receptor              the push, of noise as little as its speed allows
    slopes           five taxels of a row       u_x, u_y, of the mean of two frames
    change           u − u before, a second     u_t
    window           tactile_diffusion          sums around each taxel; those of the array
    flow             least squares of u_t + v·∇u = 0; of the whole contact, of u_t + v·∇u = c u

So a load that only grows, by a factor c a second, is no flow. On a grating only the part across its
bars is seen (aperture problem): there v = −u_t/u_x. How the area of a contact grows with its load
tells soft bodies from hard ones, and bodies feel alike where it is equal: of a sphere it is
dA/dF = 2πa²/(3F) by Hertz.

References
----------
Lucas & Kanade, Proc. 7th IJCAI (1981) 674; Negahdaripour, IEEE Trans. PAMI 20 (1998) 961, with a
factor of growth; Bicchi, Scilingo, Ricciardi &
Pietrini, Brain Res. Bull. 75 (2008) 737: tactile flow, and the contact-area spread rate.
"""

from collections.abc import Mapping
from math import exp, pi

import numpy as np

from cnnum.programs import program
from cnnum.programs.fields import Field, length, maximum, square, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.reports import report
from cnnum.programs.transients import apply
from cnnum.templates.tactile.cover_model.fields import DEPTH, READS, Carries
from cnnum.templates.tactile.shared.loads import PUSH, Loads, loads_of
from cnnum.templates.tactile.shared.pressure import pressed_of
from cnnum.templates.tactile.shared.rest import TINY, Clock, with_corners
from cnnum.templating.library import get_template
from cnnum.templating.template import Template

SHARE = 0.02
"""Share of the peak pressure from which a taxel counts as touched, as in `contact`."""

LEVEL = 10.0
"""Energy of the slopes, over that of noise, from which there is a pattern to follow."""

EXPLAINED = 0.5
"""Part of the change that a flow explains at least, where it is reported."""

LEAN = 0.01
"""Part of the slopes' energy below which a direction has none: flow is that across the bars."""

INNER = 5
"""Taxels of a side at least, so that those at its ends do not count: their slopes fall short, and
bars that lie oblique would seem to move along themselves."""

RESTS = 0.02
"""Part of a load by which it must have changed lately, where its area is said to grow with it."""

SLOPE = (1.0 / 12.0, -8.0 / 12.0, 0.0, 8.0 / 12.0, -1.0 / 12.0)
"""Weights of a slope: (8 sin k − sin 2k) / 6 of a wave k. Of waves of 6 and 4 pitches it has 96 and
85 %, so that their flow is 4 and 18 % too fast."""

PRODUCTS = ("xx", "xy", "yy", "xt", "yt")
"""Of the slopes and the change, which give the flow."""

HERTZ = 2.5
"""a² over the mean square distance from the centroid, of Hertz's pressure."""


@program
def tactile_flow(
    frame: FrameFields,
    *,
    push: float = PUSH,
    rest: float = 0.4,
    to: float = 15.0,
    window: float = 2.0,
    look: float = 0.1,
    still: float = 0.5,
    hold_time: float = 0.1,
    depth: float = DEPTH,
    reads: Carries = READS,
    unit: float = 1.0,
) -> Mapping[str, Field]:
    """Compute the flow of a load's pattern, and the growth of the contact area with the load.

    Parameters
    ----------
    frame : FrameFields
        The flow reads `normal`, in any unit; the area also reads the shear, as `contact` does.
    push : float
        −1 for strain and stress, which count tension as positive; +1 if readings rise under a push.
    rest : float, s
        Time without contact at the start, from which rest and noise are learned.
    to : float, Hz
        Corner frequency of the low-pass that is applied first.
    window : float
        Diffusion time (cells²) of the sums around each taxel.
    look : float, s
        Time constant of the sums.
    still, hold_time : float, cells/s, s
        Speed above which a flow is reported, which ends once the speed has been below half of that
        for `hold_time`.
    depth, reads, unit : float, "strain", "stress" or "force", float
        As for `contact`: cover above the taxels (pitches), measured quantity, unit of the load.

    Returns
    -------
    mapping
        `flow_x`, `flow_y`, `flow_speed` (of the whole contact, cells/s; 0 without a pattern),
        `flow_known` (flag: there is a pattern), `flow_explains` (share of the change, apart from
        growth, that the flow explains, 0 to 1), `flows` (flag: the pattern moves, and the flow
        explains at least half), `flow_map_x`, `flow_map_y` (maps: the flow around each taxel),
        `spread_area` (contact area, cells², from the spread of the pressure, assuming a sphere),
        `area_spread` (its growth, cells² per unit of load; 0 while the load is constant).

    Raises
    ------
    ProgramError
        If a parameter is out of range.
    """
    refuse_outside(
        to=(to, 1e-3, 1e6), window=(window, 0.0, 1e3), look=(look, 1e-6, 1e6),
        still=(still, 1e-6, 1e6), hold_time=(hold_time, 0.0, 1e6),
    )  # fmt: skip
    frame.sees(to, "flows")
    clock = Clock(frame, rest)
    share = 1.0 - exp(-1.0 / (frame.rate * look))
    held = {
        name: frame.memory(name).mean(product, share)
        for name, product in _products(clock, push, to).items()
    }
    sums = {name: product.sum() for name, product in held.items()}
    # noise has slopes, too: their energy at rest
    pattern = sums["xx"] + sums["yy"]
    floor = LEVEL * square(clock.noise(pattern, ("normal",)))
    known = ~clock.resting & (pattern > floor)
    # shares of the whole pattern: energies span more than single precision or 16 bits hold
    energy = where(known, pattern, 1.0)
    whole = _without_growth({name: total / energy for name, total in sums.items()})
    x, y = (where(known, part, 0.0) for part in _solved(whole, 1.0))
    explained = -1.0 * (x * whole["xt"] + y * whole["yt"]) / maximum(whole["tt"], TINY)
    spreads = get_template("tactile_diffusion")
    around = {name: held[name] / energy for name in PRODUCTS}
    if window > 0.0:
        around = {
            n: apply(spreads, input=product, duration=window) for n, product in around.items()
        }
    # a place counts as having the pattern of noise at least
    least = floor / energy / (frame.shape[0] * frame.shape[1] * LEAN)
    there = maximum(around["xx"] + around["yy"], maximum(least, TINY))
    local = [where(known, part, 0.0) for part in _solved(around, there)]
    speed = length([x, y])
    area, spread = _spread(frame.once(loads_of, push=push), depth, reads, unit, share)
    return {
        "flow_x": x,
        "flow_y": y,
        "flow_speed": speed,
        "flow_known": known,
        "flow_explains": explained,
        "flows": report(
            frame, where(explained > EXPLAINED, speed, 0.0), still, hold_time * frame.rate
        ),
        "flow_map_x": local[0],
        "flow_map_y": local[1],
        "spread_area": area,
        "area_spread": spread,
    }


def _products(clock: Clock, push: float, to: float) -> dict[str, Field]:
    """Return the products of u, of its slopes and of its change, by their names."""
    now = clock.behind(with_corners("slow_receptor", (to,)), clock.above_rest("normal", push))
    before = clock.frame.previous(now)
    middle, change = 0.5 * (now + before), clock.rate * (now - before)
    parts = {
        "x": apply(_slope(SLOPE, "x"), input=middle),
        "y": apply(_slope(SLOPE, "y"), input=middle),
        "u": middle,
        "t": change,
    }
    frame, inner = clock.frame, clock.frame.constant(1.0)
    for place, side in zip((frame.row, frame.column), frame.shape, strict=True):
        if side >= INNER:
            inner = where((place > 0.5) & (place < side - 1.5), inner, 0.0)
    return {
        name: inner * parts[name[0]] * parts[name[1]]
        for name in (*PRODUCTS, "tt", "uu", "ux", "uy", "ut")
    }


def _slope(weights: tuple[float, ...], axis: str) -> Template:
    """Return the template of the slope along an axis."""
    side = len(weights)
    kernel = np.zeros((side, side))
    kernel[side // 2] = weights
    return Template(
        f"slope along {axis}", np.zeros((1, 1)), kernel if axis == "x" else kernel.T,
        boundary="zero-flux", duration="settle", output="linear",
    )  # fmt: skip


def _without_growth(sums: Mapping[str, Field]) -> dict[str, Field]:
    """Return sums from which all that goes with u itself is taken off: c has been solved for."""
    own = maximum(sums["uu"], TINY)
    along = {name: sums[f"u{name}"] for name in "xyt"}
    return {name: sums[name] - along[name[0]] * along[name[1]] / own for name in (*PRODUCTS, "tt")}


def _solved(sums: Mapping[str, Field], energy: Field | float) -> tuple[Field, Field]:
    """Return the flow of least squares, M v = −b, less where M is small: (M² + `LEAN`²) v = −M b.

    Sums over the energy are M (xx, xy, yy) and b (xt, yt).
    """
    xx, xy, yy, xt, yt = (sums[name] / energy for name in PRODUCTS)
    wide, tall = (square(own) + square(xy) + LEAN**2 for own in (xx, yy))
    both = xy * (xx + yy)
    right, down = xx * xt + xy * yt, xy * xt + yy * yt
    whole = wide * tall - square(both)
    return (both * down - tall * right) / whole, (both * right - wide * down) / whole


def _spread(
    loads: Loads, depth: float, reads: Carries, unit: float, share: float
) -> tuple[Field, Field]:
    """Return the area by the spread of the pressure, and its slope over the load."""
    frame = loads.frame
    pressed = pressed_of(loads, SHARE, depth, reads, 1.0)
    row, column = frame.centroid(pressed.weight)
    far = square(frame.row - row) + square(frame.column - column)
    area = pi * HERTZ * (pressed.weight * far).sum() / maximum(pressed.weight.sum(), TINY)
    area, load = (where(loads.contact, value, 0.0) for value in (area, unit * pressed.normal))
    # in proportion, as A ~ F^(2/3): the mean of a slope itself is that of a while ago, when it was
    # larger. The later, larger loads count more
    late = [frame.memory(name, scalar=True) for name in ("late area", "late load")]
    change, gap = (value - memory.value for value, memory in zip((area, load), late, strict=True))
    twice = [value + memory.value for value, memory in zip((area, load), late, strict=True)]
    change = twice[1] * change / maximum(twice[0], TINY)
    for memory, value in zip(late, (area, load), strict=True):
        memory.mean(value, where(loads.contact, share, 1.0))
    both = frame.memory("area by load", scalar=True).mean(change * gap, share)
    own = frame.memory("load by load", scalar=True).mean(gap * gap, share)
    growing = own > square(RESTS * load)
    growth = both / maximum(own, TINY) * area / maximum(load, TINY)
    return area, where(loads.contact & growing, growth, 0.0)
