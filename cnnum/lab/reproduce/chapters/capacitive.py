"""Section 3.2.1: what a matrix of crossed wires reads next to the place that is pressed."""

from math import log, sqrt

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.faults import misled
from cnnum.lab.reproduce.figure import Field, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.lab.reproduce.setup import MM, E
from cnnum.tactile.halfspace import rectangle_displacement

LINES, PITCH = 9, 1.5e-3
"""Wires each way of the XSensor, and their distance, m (Fig. 3.2)."""

PRESSURE = 100e3
"""Pa, the top of its range."""

PRESSED = (3, 5)
RISE = 0.5
"""Rise of the pressed junction's capacitance; not published."""


def sunk() -> Floats:
    """Return (9, 9) depths of the surface at the junctions, one of them pressed, m."""
    place: Floats = PITCH * np.arange(LINES, dtype=np.float64)
    row, col = PRESSED
    x, y = np.meshgrid(place - PITCH * col, place - PITCH * row)
    moved = rectangle_displacement(
        x, y, 0.0, [0.0, 0.0, PRESSURE], size=(PITCH, PITCH), youngs_modulus=E
    )
    return np.asarray(moved[..., 2])


def sunk_beside() -> float:
    """Return how far the surface goes down at the next junction, of that at the pressed one."""
    row, col = PRESSED
    return float(sunk()[row, col + 1] / sunk()[row, col])


def love_beside() -> float:
    """Return the same by Johnson, Contact Mechanics, (3.25), on the axis of a square.

    A rectangle of c × b with the place at its corner moves that by c ln((b + d)/c) + b ln((c +
    d)/b), d its diagonal; the square seen from outside is four of them.
    """

    def corner(c: float, b: float) -> float:
        d = sqrt(c * c + b * b)
        return c * log((b + d) / c) + b * log((c + d) / b)

    return 2.0 * (corner(1.5, 0.5) - corner(0.5, 0.5)) / (4.0 * corner(0.5, 0.5))


def capacitances() -> Floats:
    """Return (9, 9) capacitances of the junctions, over that of one at rest."""
    unit = np.ones((LINES, LINES))
    unit[PRESSED] += RISE
    return unit


def floating(values: Floats) -> Floats:
    """Return what is read between a row and a column while all other wires are left open.

    The charge finds a way over other junctions. What a source sees between two nodes is one over
    the difference of the potentials that a unit charge makes.
    """
    rows, cols = values.shape
    network = np.zeros((rows + cols, rows + cols))
    network[:rows, rows:] = -values
    network[rows:, :rows] = -values.T
    network -= np.diag(network.sum(axis=1))
    potential = np.linalg.pinv(network)
    own = np.diag(potential)
    seen = own[:rows, None] + own[rows:] - 2.0 * potential[:rows, rows:]
    return np.asarray(1.0 / seen)


def ghost() -> float:
    """Return the change of the next junction on the same wire, of the pressed one's."""
    change = floating(capacitances()) - floating(np.ones((LINES, LINES)))
    row, col = PRESSED
    return float(abs(change[row, col + 1] / change[row, col]))


def figure_3_2() -> Figure:
    """Return what sinks, and what is read, when one junction of the matrix is pressed."""
    place = MM * PITCH * np.arange(LINES, dtype=np.float64)
    depths = 1e6 * sunk()
    read = floating(capacitances()) / floating(np.ones((LINES, LINES))) - 1.0
    return Figure(
        "section-3.2.1",
        "Section 3.2.1; Fig. 3.1",
        "A matrix of crossed wires, one junction pressed",
        "Left: how far the surface of a half-space goes down at each junction under 100 kPa on one "
        "of 1.5 mm. Right: the change that is read if one junction has half as much capacitance "
        "again and the wires that are not read are left open. Grounded, they would show nothing. "
        "The dissertation names cross-talk between neighbours, and gives neither circuit nor "
        "digits.",
        (
            Panel("Depth of the surface", "x (mm)", "y (mm)",
                  [Field(place, place, depths, "µm", diverging=False)], equal=True),
            Panel("Change read, other wires open", "x (mm)", "y (mm)",
                  [Field(place, place, 100.0 * read, "%")], equal=True),
        ),
    )  # fmt: skip


CHAPTER = Chapter(
    "Section 3.2.1 — a matrix of capacitances",
    (
        Item("section-3.2.1", "depth of the surface at the next junction, of the pressed one's",
             "section 3.2.1, cross-talk; Johnson (3.25)", love_beside(), sunk_beside, 1e-12,
             "closed form against closed form", figure="section-3.2.1",
             faults=(misled(rectangle_displacement, 0, "x", factor=1.001),
                     misled(rectangle_displacement, 2, "z", shift=1e-6))),
        Item("section-3.2.1-open", "change read at the next junction of the wire, of the pressed "
             "one's, other wires left open", "section 3.2.1: “cross-talk between the neighboring "
             "elements”", 0.0, ghost, 0.0,
             "own circuit of 9 × 9 equal junctions. No digits; with the other wires grounded it is "
             "zero, and only the rubber has cross-talk", "", "at least", kind="comparison",
             figure="section-3.2.1"),
    ),
    {"section-3.2.1": figure_3_2},
)  # fmt: skip
