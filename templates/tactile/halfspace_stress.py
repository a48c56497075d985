"""Stress under an elastic cover from the load on its surface, by diffusion waves.

The elastic half-space by diffusion waves, read out in time with known weights.

A wave of number k fades as exp(−k²t) under diffusion, and as f(kz) exp(−kz) with depth. One is a
mixture of the other (subordination), for instance

    exp(−kz) = ∫₀^∞ z/(2√π t^{3/2}) exp(−z²/4t) exp(−k²t) dt,

so the signal of taxels under a cover is one diffusion, read out again and again as it runs. The
integral is a sum over times that grow by a constant factor: the trapezoidal rule in ln t. Its error
falls exponentially with their number. Diffusion from each to the next is the exact linear template.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import ProgramError
from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply
from cnnum.templates.tactile.cover_model.fields import Surface, depth_in_cells
from cnnum.templating.library import get_template

Weight = Callable[[Floats, float], Floats]


def harmonic_weight(t: Floats, z: float) -> Floats:
    """Return the weight in time of exp(−kz)."""
    return z / (2 * math.sqrt(math.pi) * t**1.5) * np.exp(-z * z / (4 * t))


def low_pass_weight(t: Floats, z: float) -> Floats:
    """Return the weight in time of (1 + kz) exp(−kz)."""
    return z**3 / (4 * math.sqrt(math.pi) * t**2.5) * np.exp(-z * z / (4 * t))


def band_pass_weight(t: Floats, z: float) -> Floats:
    """Return the weight in time of kz exp(−kz)."""
    return harmonic_weight(t, z) * (z * z / (2 * t) - 1)


def potential_weight(t: Floats, z: float) -> Floats:
    """Return the weight in time of z exp(−kz)/(kz), for maps whose mean does not matter."""
    return np.exp(-z * z / (4 * t)) / np.sqrt(math.pi * t)


@dataclass(frozen=True, slots=True)
class Times:
    """Times at which the waves are read out.

    Attributes
    ----------
    values : tuple of float
        Cells², growing by a constant factor.
    step : float
        Its logarithm.
    """

    values: tuple[float, ...]
    step: float

    def weights(self, weight: Weight, depth: float) -> Floats:
        """Return the quadrature weights of a weight function."""
        t = np.array(self.values)
        return np.asarray(self.step * t * weight(t, depth))


def read_out_times(depth: float, shape: tuple[int, int], tolerance: float) -> Times:
    """Return times for a cover `depth` cells thick on an array of that shape.

    They span the range where weights and the slowest wave are above the tolerance. They lie as
    close as it takes to keep every filter within it on all waves of the lattice. The mean, which
    never fades, is known without.

    Raises
    ------
    ProgramError
        If the depth or the tolerance is out of range.
    """
    if not (0 < depth < math.inf and 1e-9 < tolerance < 0.1):
        raise ProgramError(
            "A cover needs a thickness above 0 cells and a tolerance between 1e-9 and 0.1, got "
            f"{depth} and {tolerance}."
        )
    slowest = 2 - 2 * math.cos(math.pi / max(2, *shape))
    digits = 3 - math.log(tolerance)
    first, last = depth * depth / (4 * digits), digits / slowest
    step = math.pi**2 / digits
    while True:
        count = max(2, math.ceil(math.log(last / first) / step) + 1)
        times = Times(tuple((first * np.exp(step * np.arange(count))).tolist()), step)
        if error_of(times, depth, slowest) <= tolerance:
            return times
        step *= 0.9


def error_of(times: Times, depth: float, slowest: float) -> float:
    """Return the largest error of the filters on waves from an array's slowest up to k² = 8."""
    squares = np.geomspace(slowest, 8.0, 200)
    k, fading = np.sqrt(squares), np.exp(-np.outer(squares, times.values))
    kz = k * depth
    wanted = {
        harmonic_weight: np.exp(-kz),
        low_pass_weight: (1 + kz) * np.exp(-kz),
        band_pass_weight: kz * np.exp(-kz),
        potential_weight: np.exp(-kz) / k,
    }
    errors = [
        float(np.abs(fading @ times.weights(weight, depth) - exact).max())
        for weight, exact in wanted.items()
    ]
    return max(errors)


@dataclass(frozen=True, slots=True)
class Waves:
    """The diffusion of one map, at the times of its read-outs.

    Attributes
    ----------
    times : Times
    maps : tuple of Field
        Without the mean.
    mean : Field
    """

    times: Times
    maps: tuple[Field, ...]
    mean: Field

    def read(self, weight: Weight, depth: float, of_mean: float) -> Field:
        """Return a read-out, `of_mean` being the filter's value at k = 0."""
        total = of_mean * self.mean
        for factor, wave in zip(self.times.weights(weight, depth), self.maps, strict=True):
            total = total + float(factor) * wave
        return total


def waves_of(value: Field, times: Times) -> Waves:
    """Let a map diffuse, zero flux over the rim, from each time of a read-out to the next."""
    diffusion, mean = get_template("tactile_diffusion"), value.mean()
    maps, wave, before = list[Field](), value - mean, 0.0
    for time in times.values:
        wave = apply(diffusion, input=wave, duration=time - before)
        maps.append(wave)
        before = time
    return Waves(times, tuple(maps), mean)


@dataclass(frozen=True, slots=True)
class WaveExtension:
    """The harmonic extension of one map, read out of its waves at a depth in cells."""

    waves: Waves
    depth: float

    def harmonic(self) -> Field:
        """Return exp(−kz) u."""
        return self.waves.read(harmonic_weight, self.depth, 1.0)

    def potential(self) -> Field:
        """Return exp(−kz)/k u."""
        return self.waves.read(potential_weight, self.depth, 0.0)

    def low_pass(self) -> Field:
        """Return (1 + kz) exp(−kz) u."""
        return self.waves.read(low_pass_weight, self.depth, 1.0)

    def band_pass(self) -> Field:
        """Return kz exp(−kz) u."""
        return self.waves.read(band_pass_weight, self.depth, 0.0)


def surface_of(frame: FrameFields, depth: float, tolerance: float) -> Surface:
    """Return the surface loads of a frame as waves, `depth` cells below the surface."""
    times = read_out_times(depth, frame.shape, tolerance)
    x, y, p = (
        WaveExtension(waves_of(frame.channel(c), times), depth)
        for c in ("shear_x", "shear_y", "normal")
    )
    return Surface(x, y, p, depth)


@program
def halfspace_stress(
    frame: FrameFields,
    *,
    thickness: float = 1.0e-3,
    pitch: float = 1.5e-3,
    cells: int = 1,
    tolerance: float = 1e-6,
) -> Mapping[str, Field]:
    """Compute the stress at the taxels under a load on an incompressible cover.

    On the lattice, k² is the eigenvalue of the negative five-point Laplacian. No flux crosses the
    rim of the array, as if the load continued mirrored beyond it. The error against the half-space
    falls with the square of the ratio of cell size to thickness.

    Parameters
    ----------
    frame : FrameFields
        Surface tractions in each cell, Pa: `shear_x`, `shear_y`, and the pressure `normal`.
    thickness : float, m
        Thickness of the cover.
    pitch : float, m
        Pitch of the taxels.
    cells : int
        Cells per taxel along each axis: 8×8 taxels with 4 cells each are an array of 32×32.
    tolerance : float
        Tolerance of the attenuation of every wave, as a share of the load.

    Returns
    -------
    mapping
        `stress_xz`, `stress_yz`, `stress_zz`: maps, Pa, tension positive.

    Raises
    ------
    ProgramError
        If a size or the tolerance is out of range.

    References
    ----------
    Johnson, Contact Mechanics, 3.2 (Boussinesq, Cerruti), transformed along the surface.
    """
    return surface_of(frame, depth_in_cells(thickness, pitch, cells), tolerance).stress()
