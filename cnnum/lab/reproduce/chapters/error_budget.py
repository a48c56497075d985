"""Section 5.3.1 as numbers: how far errors of the experiment move the place that is found."""

from collections.abc import Callable
from functools import partial

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.chapters.hyperacuity import FINE
from cnnum.lab.reproduce.figure import Curve, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.lab.reproduce.setup import LOAD, UM, E, Z
from cnnum.tactile.halfspace import strain
from cnnum.tactile.inverse import locate

NEEDLE = 50e-6
"""Radius of its tip, m (3.4.2)."""

TAXEL = 100e-6
"""Side of the suspended plate, m (Fig. 3.8)."""

TILT = np.radians(2.0)
"""Tilt of the needle; no value is published."""

UNEVEN = 5e-6
"""Unevenness of the rubber's thickness, m: "a few microns"."""

SIDE = 13


def places() -> tuple[Floats, Floats]:
    """Return places of the needle within 150 µm of the middle, m."""
    side = np.linspace(-FINE, FINE, SIDE)
    x, y = (part.reshape(-1) for part in np.meshgrid(side, side))
    near = np.hypot(x, y) <= FINE
    return x[near], y[near]


def disc(radius: float) -> tuple[Floats, Floats]:
    """Return offsets, m, and weights of a Hertz pressure over a disc."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    share = 0.5 * (nodes + 1.0)  # 1 − (ρ/a)² to the power 3/2 is what lies outside ρ
    rho = radius * np.sqrt(1.0 - (1.0 - share) ** (2.0 / 3.0))
    turn = 2.0 * np.pi * (np.arange(16) + 0.5) / 16
    spots = np.stack(np.broadcast_arrays(rho[:, None] * np.cos(turn), rho[:, None] * np.sin(turn)))
    return spots.reshape(2, -1).T, np.repeat(0.5 * weights / 16, 16)


def square(side: float) -> tuple[Floats, Floats]:
    """Return offsets, m, and weights of the mean over a square."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    x, y = np.meshgrid(0.5 * side * nodes, 0.5 * side * nodes)
    return np.stack([x.reshape(-1), y.reshape(-1)], axis=-1), np.outer(weights, weights).ravel() / 4


POINT = (np.zeros((1, 2)), np.ones(1))


def found(
    spread: tuple[Floats, Floats] = POINT,
    depth: float = Z,
    tilt: float = 0.0,
) -> tuple[Floats, Floats, Floats]:
    """Return places of the needle and errors of the place found, m.

    Parameters
    ----------
    spread : (n, 2) and (n,) float
        Offsets of the load's parts (or of the taxel's), and their shares.
    depth : float, m
        The cover's true thickness; it is taken for Z.
    tilt : float, rad
        Towards x.
    """  # fmt: skip
    x, y = places()
    offsets, shares = spread
    force = LOAD * np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    away = np.stack([x, y], axis=-1)[:, np.newaxis] + offsets
    parts = strain(-away[..., 0], -away[..., 1], depth, force, youngs_modulus=E)[..., 2]
    load = locate(np.einsum("ijk,j->ik", parts, shares), depth=Z, youngs_modulus=E)
    return x, y, np.asarray(np.hypot(load.x - x, load.y - y))


SOURCES: dict[str, tuple[str, Callable[[], tuple[Floats, Floats, Floats]]]] = {
    "needle": (f"a tip of Ø {UM * 2 * NEEDLE:.0f} µm, a Hertz contact",
               lambda: found(disc(NEEDLE))),
    "taxel": (f"a plate of {UM * TAXEL:.0f} µm that averages the strain",
              lambda: found(square(TAXEL))),
    "tilt": ("a needle that leans by 2°: the force is misread, the place is not",
             lambda: found(tilt=float(TILT))),
    "rubber": (f"a cover thicker by {UM * UNEVEN:.0f} µm", lambda: found(depth=Z + UNEVEN)),
}  # fmt: skip


def budget(source: str) -> float:
    """Return the RMS error of place within 150 µm of one source, µm."""
    return float(UM * np.sqrt(np.mean(SOURCES[source][1]()[2] ** 2)))


def figure_budget() -> Figure:
    """Return the error of each source over the distance from the middle."""
    curves = list[Curve]()
    for name, (_, make) in SOURCES.items():
        x, y, error = make()
        on_line = np.abs(y) < 1e-9
        curves.append(Curve(UM * x[on_line], UM * error[on_line], name))
    return Figure(
        "section-5.3.1",
        "Section 5.3.1",
        "What moves the place that one taxel finds",
        "The dissertation lists these sources and gives no numbers. Each alone, on exact strain "
        "of a half-space, along y = 0: what is averaged over its size, leans, or is thicker than "
        "assumed. Published is a precision of 3–5 µm with all of them.",
        (Panel("Error of the place", "x of the needle (µm)", "error (µm)", curves),),
    )


CHAPTER = Chapter(
    "Section 5.3.1 — the error budget",
    tuple(
        Item(f"section-5.3.1-{name}", f"RMS error of place within 150 µm by {what}",
             "section 5.3.1; precision: 3–5 µm", (3.0, 5.0), partial(budget, name), 0.0,
             "the dissertation has the sum of all sources, this is one of them", "µm", "within",
             kind="comparison", figure="section-5.3.1")
        for name, (what, _) in SOURCES.items()
    ),
    {"section-5.3.1": figure_budget},
)  # fmt: skip
