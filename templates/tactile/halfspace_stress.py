"""Stress under an elastic cover from the load on its surface, by diffusion waves."""

from collections.abc import Mapping
from dataclasses import dataclass

from cnnum.library import get_template
from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply
from cnnum.templates.tactile.diffusion_waves import (
    Waves,
    Weight,
    band_pass_weight,
    harmonic_weight,
    low_pass_weight,
    potential_weight,
    read_out_times,
    waves_of,
)


@dataclass(frozen=True, slots=True)
class Surface:
    """The loads on the surface as waves, and the depth in cells."""

    x: Waves
    y: Waves
    pressure: Waves
    depth: float

    def sheared(self, along: str) -> Field:
        """Return σ_xz or σ_yz: z ∂_i P − Q_i − z ∂_i(∂_x R_x + ∂_y R_y), R = exp(−kz)/k q."""
        own = self.x if along == "x" else self.y
        inner = self.depth * (self.read(self.pressure, harmonic_weight, 1.0) - self.spread())
        return gradient(inner, along) - self.read(own, harmonic_weight, 1.0)

    def spread(self) -> Field:
        """Return ∂_x R_x + ∂_y R_y, with R = exp(−kz)/k q."""
        x = self.read(self.x, potential_weight, 0.0)
        y = self.read(self.y, potential_weight, 0.0)
        return gradient(x, "x") + gradient(y, "y")

    def pushed(self) -> Field:
        """Return ∂_x Q_x + ∂_y Q_y."""
        x = self.read(self.x, harmonic_weight, 1.0)
        y = self.read(self.y, harmonic_weight, 1.0)
        return gradient(x, "x") + gradient(y, "y")

    def low_pass(self) -> Field:
        """Return (1 + kz) exp(−kz) p."""
        return self.read(self.pressure, low_pass_weight, 1.0)

    def band_pass(self) -> Field:
        """Return kz exp(−kz) p."""
        return self.read(self.pressure, band_pass_weight, 0.0)

    def read(self, waves: Waves, weight: Weight, of_mean: float) -> Field:
        """Return a read-out at this depth."""
        return waves.read(weight, self.depth, of_mean)


def surface_of(frame: FrameFields, thickness: float, pitch: float, tolerance: float) -> Surface:
    """Return the surface loads of a frame as waves."""
    depth = thickness / pitch
    times = read_out_times(depth, frame.shape, tolerance)
    x, y, p = (waves_of(frame.channel(c), times) for c in ("shear_x", "shear_y", "normal"))
    return Surface(x, y, p, depth)


def gradient(value: Field, along: str) -> Field:
    """Return a central difference along columns ("x") or rows ("y"), a cell."""
    return apply(get_template(f"gradient_{along}"), input=value)


@program
def halfspace_stress(
    frame: FrameFields,
    *,
    thickness: float = 1.0e-3,
    pitch: float = 1.5e-3,
    tolerance: float = 1e-5,
) -> Mapping[str, Field]:
    """Stress that taxels see under a load on an incompressible cover.

    On the lattice k is the root of the five-point Laplacian's eigenvalue, and no flux crosses the
    rim of the array, as if the load went on mirrored; the error against the half-space falls as
    the square of the cell over the thickness.

    Parameters
    ----------
    frame : FrameFields
        Surface tractions, Pa: `shear_x`, `shear_y`, and the pressure `normal`.
    thickness : float, m
        Of the cover.
    pitch : float, m
        Of the cells.
    tolerance : float
        Of every wave's fading, as a share of the load.

    Returns
    -------
    mapping
        `stress_xz`, `stress_yz`, `stress_zz`: maps, Pa, tension positive.

    References
    ----------
    Johnson, Contact Mechanics, 3.2 (Boussinesq, Cerruti), transformed along the surface.
    """
    surface = surface_of(frame, thickness, pitch, tolerance)
    return {
        "stress_xz": surface.sheared("x"),
        "stress_yz": surface.sheared("y"),
        "stress_zz": surface.depth * surface.pushed() - surface.low_pass(),
    }
