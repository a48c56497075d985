"""Fields under a cover, and the filter that takes the blur of the cover off.

Stress and strain under a cover from the harmonic extensions of the load on its surface.

Two programs make the extensions, by diffusion waves and by layers of depth. The derived fields
are the same, and stand here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np

from cnnum.errors import ProgramError, name_error
from cnnum.programs.fields import Field
from cnnum.programs.transients import apply
from cnnum.tactile.bump_loads import unblur_kernel
from cnnum.tactile.indenters import Reads
from cnnum.templating.library import get_template
from cnnum.templating.template import Template

DEPTH = 0.5
"""Pitches of cover above the taxels: 0.8 mm over taxels 1.5 mm apart, about."""

READS: Reads = "strain"
"""The quantity of a calibrated array (dissertation, 4.3.2)."""

Carries = Literal["strain", "stress", "force"]
"""The measured quantity; "force" is each taxel's own share of the load."""


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


def noise_gain(depth: float = DEPTH, reads: Carries = READS) -> float:
    """Return the noise of the load over that of a reading."""
    if reads == "force":
        return 1.0
    return float(np.sqrt((unblur_kernel(float(depth), reads) ** 2).sum()))


def surface_load(normal: Field, depth: float = DEPTH, reads: Carries = READS) -> Field:
    """Return the pressure on the surface, in the reading's unit for a unit pressure.

    Taxels that each carry their own share of the load read it themselves.
    """
    if reads not in get_args(Carries):
        raise name_error("reading", reads, get_args(Carries))
    if reads == "force":
        return normal
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


class Extension(Protocol):
    """One map of the surface load u, at the depth z of the taxels."""

    def harmonic(self) -> Field:
        """Return exp(−kz) u."""
        ...

    def potential(self) -> Field:
        """Return exp(−kz)/k u, in cells, of use where the mean does not matter."""
        ...

    def low_pass(self) -> Field:
        """Return (1 + kz) exp(−kz) u."""
        ...

    def band_pass(self) -> Field:
        """Return kz exp(−kz) u."""
        ...


THINNEST, THICKEST = 0.001, 100.0
"""Cells: the stack of a thicker cover has no layer at the taxels, a thinner one has no depth."""


@dataclass(frozen=True, slots=True)
class Surface:
    """The three loads on the surface at the depth of the taxels, in cells."""

    x: Extension
    y: Extension
    pressure: Extension
    depth: float

    def stress(self) -> Mapping[str, Field]:
        """Return σ_xz, σ_yz, σ_zz, tension positive."""
        return {
            "stress_xz": self._sheared("x"),
            "stress_yz": self._sheared("y"),
            "stress_zz": self.depth * self._pushed() - self.pressure.low_pass(),
        }

    def strain(self, youngs_modulus: float) -> Mapping[str, Field]:
        """Return ε_xz, ε_yz (tensor shear), ε_zz of an incompressible cover."""
        compliance = 1.5 / youngs_modulus
        normal = self.depth * self._pushed() - self._spread() - self.pressure.band_pass()
        return {
            "strain_xz": compliance * self._sheared("x"),
            "strain_yz": compliance * self._sheared("y"),
            "strain_zz": compliance * normal,
        }

    def _sheared(self, along: str) -> Field:
        """Return σ_xz or σ_yz: z ∂_i P − Q_i − z ∂_i(∂_x R_x + ∂_y R_y), R = exp(−kz)/k q."""
        own, other, across = (self.x, self.y, "y") if along == "x" else (self.y, self.x, "x")
        bent = curvature(own.potential(), along)
        bent = bent + gradient(gradient(other.potential(), across), along)
        slope = gradient(self.pressure.harmonic(), along)
        return self.depth * (slope - bent) - own.harmonic()

    def _spread(self) -> Field:
        """Return ∂_x R_x + ∂_y R_y, with R = exp(−kz)/k q."""
        return gradient(self.x.potential(), "x") + gradient(self.y.potential(), "y")

    def _pushed(self) -> Field:
        """Return ∂_x Q_x + ∂_y Q_y."""
        return gradient(self.x.harmonic(), "x") + gradient(self.y.harmonic(), "y")


def gradient(value: Field, along: str) -> Field:
    """Return a central difference along columns ("x") or rows ("y"), a cell."""
    return apply(get_template(f"gradient_{along}"), input=value)


def curvature(value: Field, along: str) -> Field:
    """Return a second difference along columns ("x") or rows ("y"), a cell².

    Two central differences would not do: the first is odd about the rim, where the second would
    take it for even.
    """
    row = np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 1.0], [0.0, 0.0, 0.0]])
    kernel = row if along == "x" else row.T
    second = Template(f"curvature {along}", [[0.0]], kernel, boundary="zero-flux", output="linear")
    return apply(second, input=value)


def depth_in_cells(thickness: float, pitch: float, cells: int) -> float:
    """Return how many cells thick a cover is.

    Parameters
    ----------
    thickness, pitch : float, m
        Of the cover, and of the taxels.
    cells : int
        Cells a taxel, along each axis.

    Raises
    ------
    ProgramError
        If one of them is not above 0, or `cells` is not whole. Also if the cover is thinner or
        thicker than the programs can compute with.
    """
    if not (thickness > 0 and pitch > 0 and cells >= 1 and int(cells) == cells):
        raise ProgramError(
            "Expected a thickness and a pitch above 0 and a whole number of cells per taxel; got "
            f"thickness={thickness}, pitch={pitch} and cells={cells}."
        )
    depth = thickness * cells / pitch
    if not THINNEST <= depth <= THICKEST:
        raise ProgramError(
            f"A cover must be {THINNEST:g} to {THICKEST:g} cells thick, got {depth:g}: change "
            "'thickness', 'pitch' or 'cells'."
        )
    return depth
