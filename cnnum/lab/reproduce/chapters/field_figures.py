"""Pictures of section 4.2, as data."""

from collections.abc import Callable

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.figure import Curve, Field, Figure, Panel
from cnnum.lab.reproduce.setup import MM, NEWTON, E, Z
from cnnum.tactile.halfspace import (
    displacement,
    line_load_stress,
    low_pass,
    strain,
    strain_energy_density,
    stress,
)

X = np.linspace(-1e-3, 1e-3, 201)
DEPTHS = (0.1e-3, 0.2e-3, 0.3e-3, 0.4e-3)
NEWTON_NOTE = "Point load of 1 N, E = 0.87 MPa, ν = 0.5."


def figure_4_2() -> Figure:
    """Return the stress around a point load, in the plane through the load."""
    z = np.linspace(0.05e-3, 0.6e-3, 112)
    field = stress(X, 0.0, z[:, np.newaxis], NEWTON)
    panels = [
        Panel(
            f"{name} (MPa, ±20 at most)",
            "x (mm)",
            "depth z (mm)",
            [Field(MM * X, MM * z, np.clip(field[..., i, 2] / 1e6, -20, 20), "MPa", levels=9)],
            depth=True,
        )
        for i, name in ((2, "normal stress σ_zz"), (0, "shear stress σ_xz"))
    ]
    return Figure(
        "fig-4.2",
        "Fig. 4.2",
        "Stress below a point load",
        f"{NEWTON_NOTE} In every plane below the load σ_xz has its extrema at |x| = z/2.",
        panels,
    )


def figure_4_3() -> Figure:
    """Return two components of the stress at several depths."""
    panels = [
        Panel(
            name,
            "x (mm)",
            "stress (MPa)",
            [
                Curve(MM * X, stress(X, 0.0, z, NEWTON)[..., i, 2] / 1e6, f"z = {MM * z:.1f} mm")
                for z in DEPTHS
            ],
        )
        for i, name in ((2, "normal stress σ_zz"), (0, "shear stress σ_xz"))
    ]
    return Figure(
        "fig-4.3",
        "Fig. 4.3",
        "Stress fades with depth",
        f"{NEWTON_NOTE} Below the load σ_zz falls as 1/z².",
        panels,
    )


def figure_4_4() -> Figure:
    """Return the normalised stress and its spectrum at several depths."""
    waves = np.linspace(0.0, 40e3, 161)
    profiles = [stress(X, 0.0, z, NEWTON)[..., 2, 2] for z in DEPTHS]
    labels = [f"z = {MM * z:.1f} mm" for z in DEPTHS]
    return Figure(
        "fig-4.4",
        "Fig. 4.4",
        "The cover is a low-pass for normal stress",
        "Left: σ_zz over its peak. Right: its transform over the plane, (1 + kz) exp(−kz).",
        (
            Panel("Normalised σ_zz", "x (mm)", "share of the peak",
                  [Curve(MM * X, p / p.min(), n) for p, n in zip(profiles, labels, strict=True)]),
            Panel("Transfer function", "wave number k (rad/mm)", "share passed",
                  [Curve(waves / MM, low_pass(waves, z), n)
                   for z, n in zip(DEPTHS, labels, strict=True)]),
        ),
    )  # fmt: skip


def figure_4_5() -> Figure:
    """Return the three strains that a taxel sees, over the plane 0.2 mm below."""
    side = np.linspace(-0.6e-3, 0.6e-3, 121)
    field = strain(side, side[:, np.newaxis], Z, NEWTON, youngs_modulus=E)[..., 2]
    names = ("shear strain ε_xz", "shear strain ε_yz", "normal strain ε_zz")
    maps = [
        Panel(name, "x (mm)", "y (mm)",
              [Field(MM * side, MM * side, field[..., i], "strain", levels=9)], equal=True)
        for i, name in enumerate(names)
    ]  # fmt: skip
    middle = field[60]
    cut = Panel(
        "Cut at y = 0",
        "x (mm)",
        "strain",
        [Curve(MM * side, middle[:, i], n.split()[-1]) for i, n in enumerate(names)],
        marks=[(MM * np.sqrt(2.0) * Z, "√2 z"), (MM * 2 * Z, "2z")],
    )
    return Figure(
        "fig-4.5",
        "Fig. 4.5",
        "Three strains 0.2 mm below a point load",
        f"{NEWTON_NOTE} ε_zz crosses zero at √2 z and has its opposite extremum at 2z: the "
        "“Mexican hat”. (1 N is the dissertation's; such strains are outside linear elasticity.)",
        (*maps, cut),
    )


def figure_4_6() -> Figure:
    """Return the normalised shapes of displacement, stress, strain and energy."""
    full = strain(X, 0.0, Z, NEWTON, youngs_modulus=E)
    stresses = stress(X, 0.0, Z, NEWTON)
    moved = displacement(X, 0.0, Z, NEWTON, youngs_modulus=E)
    energy = strain_energy_density(X, 0.0, Z, NEWTON, youngs_modulus=E)
    normal = {
        "displacement u_z": moved[:, 2],
        "stress σ_zz": stresses[:, 2, 2],
        "strain ε_zz": full[:, 2, 2],
        "strain energy": energy,
    }
    shear = {
        "displacement u_x": (moved[:, 0], moved[:, 2]),
        "stress σ_xz": (stresses[:, 0, 2], stresses[:, 2, 2]),
        "strain ε_xz": (full[:, 0, 2], full[:, 2, 2]),
    }
    middle = len(X) // 2
    return Figure(
        "fig-4.6",
        "Fig. 4.6",
        "Which quantity does a taxel feel?",
        "At a depth of 0.2 mm. Only the strain has a negative brim, as the measured signals do "
        "(Fig. 4.13). Shear is relative to the peak of its own normal component.",
        (
            Panel("Normal components", "x (mm)", "share of the peak",
                  [Curve(MM * X, v / v[middle], n) for n, v in normal.items()]),
            Panel("Shear components", "x (mm)", "share of the normal peak",
                  [Curve(MM * X, s / abs(v[middle]), n) for n, (s, v) in shear.items()]),
        ),
    )  # fmt: skip


def superposed(x: Floats, z: Floats, weights: Floats, places: Floats) -> Floats:
    """Return (depths, n) σ_zz of line loads side by side, per unit of pressure."""
    force = np.array([0.0, 0.0, 1.0])
    one = line_load_stress(x[:, np.newaxis] - places, z[:, np.newaxis, np.newaxis], force)
    return np.asarray(one[..., 2, 2] @ weights)


def flat_lines(count: int = 400) -> Floats:
    """Return the places of equal line loads that stand for a rigid flat strip, in half-widths.

    Its pressure is 2/(π√(1 − s²)) of the mean, and these are Chebyshev's nodes.
    """
    return np.asarray(np.cos(np.pi * (np.arange(count) + 0.5) / count), dtype=np.float64)


def flat_strip(x: Floats, z: Floats) -> Floats:
    """Return σ_zz below a rigid flat strip over its mean pressure; lengths in half-widths."""
    nodes = flat_lines()
    return superposed(x, z, np.full(nodes.size, 2.0 / nodes.size), nodes)


def flat_punch_stress(x: Floats, z: Floats | float) -> Floats:
    """Return the closed form of `flat_strip`.

    With F = 2/(π√(1 − ζ²)) of ζ = x + iz, P = Re F is the pressure's harmonic extension, and
    σ_zz = −(P − z ∂P/∂z) = −(Re F + z Im F′).

    Parameters
    ----------
    x, z : float
        Along the surface and below it, in half-widths, of shapes that go together.
    """
    place = x + 1j * np.asarray(z)
    # of the two roots the one that makes F fade above the real axis
    power = 1j / (np.sqrt(place - 1.0) * np.sqrt(place + 1.0))
    slope = place * power / (1.0 - place**2)
    return np.asarray(-2.0 / np.pi * (power.real + z * slope.imag), dtype=np.float64)


def profile(shape: Callable[[Floats], Floats], x: Floats, z: Floats) -> Floats:
    """Return σ_zz below a strip of that pressure over its mean; lengths in half-widths."""
    nodes, weights = np.polynomial.legendre.leggauss(200)
    pressure = shape(nodes)
    return superposed(x, z, 2.0 * weights * pressure / (weights @ pressure), nodes)


def figure_4_7() -> Figure:
    """Return σ_zz below a point load and three extended ones."""
    x, z = np.linspace(-2.0, 2.0, 121), np.linspace(0.03, 1.5, 60)
    point = stress(x, 0.0, z[:, np.newaxis], NEWTON)[..., 2, 2]
    maps = {
        "point load": point,
        "rigid flat strip": flat_strip(x, z),
        "rigid round strip": profile(lambda s: np.sqrt(1.0 - s**2), x, z),
        "rigid wedge": profile(lambda s: np.arccosh(1.0 / np.abs(s)), x, z),
    }
    panels = [
        Panel(name, "x / half-width", "z / half-width",
              [Field(x, z, np.log10(np.maximum(-values, 1e-3)), "log₁₀(−σ_zz / mean pressure)",
                     levels=12, diverging=False)], depth=True)
        for name, values in maps.items()
    ]  # fmt: skip
    return Figure(
        "fig-4.7",
        "Fig. 4.7",
        "Normal stress below four indenters",
        "The extended ones are made of line loads, each with the pressure of a frictionless "
        "contact. The flat one's stress stands at its edges, near the surface only.",
        panels,
    )


FIGURES: dict[str, Callable[[], Figure]] = {
    "fig-4.2": figure_4_2,
    "fig-4.3": figure_4_3,
    "fig-4.4": figure_4_4,
    "fig-4.5": figure_4_5,
    "fig-4.6": figure_4_6,
    "fig-4.7": figure_4_7,
}
