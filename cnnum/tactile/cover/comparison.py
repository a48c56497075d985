"""The error of each model of a flat cover against measurements on real ones.

A comparison, not a check: no model here reproduces the measured numbers.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.errors import PhysicsError
from cnnum.tactile import checks
from cnnum.tactile.checks import Array
from cnnum.tactile.cover.layer import layer_waves
from cnnum.tactile.halfspace import band_pass, low_pass

NEEDLE = 50e-6
"""Radius of the needle, m (Ø 100 µm)."""

TAXEL = 300e-6 / math.sqrt(math.pi)
"""Radius of the disc that is as large as a taxel of 300 × 300 µm², m."""

THICKNESSES = tuple(np.linspace(0.2e-3, 0.5e-3, 4).tolist())
"""The range of covers that the dissertation calls practical, m."""

REACH = 40.0
"""kz up to which waves count."""

PANELS = 60
"""Number of panels with 16 Gauss points each: eight per period of the fastest Bessel function."""

Waves = Callable[[Array, float], tuple[Array, Array]]
Curve = Callable[[Array], Array]


@dataclass(frozen=True, slots=True)
class Model:
    """A cover as two spatial filters of a normal load.

    Attributes
    ----------
    name : str
    waves : callable
        (k, thickness) to the normal and, divided by i, the shear signal over the pressure.
    spread : tuple of float, m
        Radii of discs over which the load or the taxel averages.
    """

    name: str
    waves: Waves
    spread: tuple[float, ...] = ()

    def curves(self, thickness: float) -> tuple[Curve, Curve]:
        """Return the normal and the shear signal of a unit force over the distance, m."""
        from scipy.special import j0, j1

        k, weight = _points(thickness)
        blur = math.prod((_disc(k * radius) for radius in self.spread), start=np.ones_like(k))
        normal, shear = self.waves(k, thickness)
        measure = k * weight * blur / (2 * math.pi)
        return (
            lambda x: np.asarray(j0(np.multiply.outer(x, k)) @ (measure * normal)),
            lambda x: np.asarray(-j1(np.multiply.outer(x, k)) @ (measure * shear)),
        )


@dataclass(frozen=True, slots=True)
class Merit:
    """Figures of merit of one curve (dissertation 4.3.3).

    Attributes
    ----------
    width : float, m
        W, between the zeros of the normal signal; NaN if it has none worth the name.
    amplitude : float
        A, its maximum.
    inhibition : float
        Its maximum over its most negative value; infinite if it has none.
    normal_to_shear : float
        Its maximum over the largest shear signal.
    """

    width: float
    amplitude: float
    inhibition: float
    normal_to_shear: float


@dataclass(frozen=True, slots=True)
class ComparisonRow:
    """One number of one model, with the measured one.

    Attributes
    ----------
    model, quantity, source : str
    measured, got : float
        `got` is NaN where the model's curve does not have the feature.
    """

    model: str
    quantity: str
    source: str
    measured: float
    got: float

    @property
    def ratio(self) -> float:
        """Got over measured."""
        return self.got / self.measured


def half_space_strain(k: Array, thickness: float) -> tuple[Array, Array]:
    """Return the dissertation's model: Eε_zz and Eε_kz/i in a half-space, ν = 0.5 (4.12)."""
    hat = 1.5 * band_pass(k, thickness)
    return -hat, hat


def half_space_stress(k: Array, thickness: float) -> tuple[Array, Array]:
    """Return σ_zz and σ_kz/i in a half-space (4.11)."""
    return -low_pass(k, thickness), band_pass(k, thickness)


def layer_stress(k: Array, thickness: float) -> tuple[Array, Array]:
    """Return σ_zz and σ_kz/i on the rigid base of a layer, ν = 0.5."""
    waves = layer_waves(k, thickness, thickness=thickness)
    return waves.zz_p, waves.along_p


def layer_strain(k: Array, thickness: float, *, height: float = 50e-6) -> tuple[Array, Array]:
    """Return Gε_zz and Gε_kz/i in a layer, a little (m) above its rigid base, ν = 0.5.

    On the base itself ε_zz is zero: the strain that a taxel there senses comes from above.
    """
    waves = layer_waves(k, max(thickness - height, 0.0), thickness=thickness)
    return waves.strain_p, waves.along_p / 2


POINTED = (
    Model("half-space, strain", half_space_strain),
    Model("half-space, stress", half_space_stress),
    Model("bonded layer, stress on the base", layer_stress),
    Model("bonded layer, strain 50 µm above the base", layer_strain),
)
MODELS = (
    *POINTED,
    *(Model(f"{m.name}; needle and taxel", m.waves, (NEEDLE, TAXEL)) for m in POINTED),
)
"""Point load and point taxel first, then both of the size they had."""


def merit(model: Model, thickness: float) -> Merit:
    """Return the figures of merit of a model's curves at a thickness.

    Parameters
    ----------
    model : Model
    thickness : float, m

    Raises
    ------
    PhysicsError
        If the thickness is not positive and finite.
    """
    checks.record("model", model, Model)
    size = checks.scalar("thickness", checks.positive("thickness", thickness))
    normal, shear = model.curves(size)
    scale = size + sum(model.spread)
    x = np.linspace(0, 6 * scale, 201)
    signal = -normal(x)
    low = _top(-signal)
    peak = float(signal[0])
    # a dip of less than a thousandth would not be seen in the noise of any taxel
    dips = low > 1e-3 * peak
    return Merit(
        width=2 * _first_zero(normal, x, signal) if dips else math.nan,
        amplitude=peak,
        inhibition=peak / low if dips else math.inf,
        normal_to_shear=peak / _top(np.abs(shear(x[: len(x) // 2]))),
    )


def compare(
    models: Sequence[Model] = MODELS, thicknesses: Sequence[float] = THICKNESSES
) -> tuple[ComparisonRow, ...]:
    """Return how far models get from the numbers measured on flat covers.

    Parameters
    ----------
    models : sequence of Model
    thicknesses : sequence of float, m
        Over which W and A are fitted; two and more.

    Returns
    -------
    tuple of ComparisonRow
        Four a model: slope of W, exponent of A, lateral inhibition, normal over shear signal.

    Raises
    ------
    PhysicsError
        If a thickness is not positive, or there are fewer than two.

    References
    ----------
    Vásárhelyi, dissertation (2007), 4.3.3 and Fig. 4.13, 4.16. The last row is β_ns = 1.46
    times the half-space's 25√5/24: the measured value before any model entered.
    """
    if len(set(thicknesses)) < 2:
        raise PhysicsError(f"Expected two thicknesses or more, got {len(set(thicknesses))}.")
    return tuple(row for model in models for row in _rows(model, thicknesses))


def _rows(model: Model, thicknesses: Sequence[float]) -> list[ComparisonRow]:
    merits = [merit(model, thickness) for thickness in thicknesses]
    z = np.asarray(thicknesses)
    widths = np.array([m.width for m in merits])
    slope = float(np.polyfit(z, widths, 1)[0]) if np.isfinite(widths).all() else math.nan
    fall = float(np.polyfit(np.log(z), np.log([m.amplitude for m in merits]), 1)[0])
    source = "4.3.3, Fig. 4.16"
    return [
        ComparisonRow(model.name, "slope of W over thickness", source, 1.14, slope),
        ComparisonRow(model.name, "exponent of A over thickness", source, -1.45, fall),
        ComparisonRow(
            model.name,
            "lateral inhibition at 180 µm",
            "4.3.3, Fig. 4.13",
            19.0,
            merit(model, 180e-6).inhibition,
        ),
        ComparisonRow(
            model.name,
            "largest normal over largest shear signal at 200 µm",
            "(4.20)",
            1.46 * 25 * math.sqrt(5) / 24,
            merit(model, 200e-6).normal_to_shear,
        ),
    ]


def _points(thickness: float) -> tuple[Array, Array]:
    """Return Gauss points and weights on (0, REACH/z)."""
    x, w = np.polynomial.legendre.leggauss(16)
    width = REACH / thickness / PANELS
    starts = width * np.arange(PANELS)[:, None]
    return (starts + width * (x + 1) / 2).reshape(-1), np.tile(w * width / 2, PANELS)


def _disc(reach: Array) -> Array:
    """Return the transform of the mean over a disc, 2 J1(ka)/(ka)."""
    from scipy.special import j1

    return np.asarray(2 * j1(reach) / reach)


def _first_zero(normal: Curve, x: Array, signal: Array) -> float:
    from scipy.optimize import brentq

    after = int(np.flatnonzero(signal <= 0)[0])
    return float(brentq(lambda at: float(normal(np.asarray(at))), x[after - 1], x[after]))


def _top(values: Array) -> float:
    """Return the height of the parabola through the largest of equally spaced values."""
    n = int(values.argmax())
    if n in (0, len(values) - 1):
        return float(values[n])
    a, b, c = values[n - 1 : n + 2].tolist()
    return float(b - (a - c) ** 2 / (8 * (a - 2 * b + c)))
