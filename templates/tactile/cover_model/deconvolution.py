"""The load on the surface, from readings of the taxels under the cover."""

from collections.abc import Sequence
from typing import get_args

import numpy as np

from cnnum.errors import name_error
from cnnum.programs.fields import Field
from cnnum.programs.transients import apply
from cnnum.tactile.bump_loads import unblur_kernel
from cnnum.tactile.indenters import Reads
from cnnum.templating.template import Template

DEPTH = 0.5
"""Pitches of cover above the taxels: 0.8 mm over taxels 1.5 mm apart, about."""

READS: Reads = "strain"
"""The quantity of a calibrated array (dissertation, 4.3.2)."""


def unblur(depth: float = DEPTH, reads: Reads = READS) -> Template:
    """Return the template that takes the cover's blur off, see `unblur_kernel`.

    Raises
    ------
    PhysicsError
        If the depth is out of range.
    UnknownNameError
        If `reads` is neither "strain" nor "stress".
    """
    if reads not in get_args(Reads):
        raise name_error("reading", reads, get_args(Reads))
    text = f"Takes the blur of {depth:g} pitches of cover off normal {reads}."
    return filter_template(f"unblur {reads} {depth:g}", unblur_kernel(float(depth), reads), text)


def noise_gain(depth: float = DEPTH, reads: Reads = READS) -> float:
    """Return the noise of the load over that of a reading."""
    return float(np.sqrt((unblur_kernel(float(depth), reads) ** 2).sum()))


def surface_load(normal: Field, depth: float = DEPTH, reads: Reads = READS) -> Field:
    """Return the pressure on the surface, in the reading's unit for a unit pressure."""
    return apply(unblur(depth, reads), input=normal)


def filter_template(
    name: str, kernel: Sequence[Sequence[float]] | np.ndarray, description: str
) -> Template:
    """Return the template that correlates its input with a kernel, 0 beyond the array."""
    return Template(
        name,
        np.zeros((1, 1)),
        np.asarray(kernel, dtype=np.float64),
        boundary=0.0,
        duration="settle",
        output="linear",
        description=description,
    )
