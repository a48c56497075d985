"""Section 4.2: the point load on a half-space, equation by equation and figure by figure."""

from collections.abc import Callable
from functools import partial
from math import exp, pi, sqrt

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar
from scipy.special import j0

from cnnum.arrays import Floats
from cnnum.lab.reproduce.chapters import printed
from cnnum.lab.reproduce.faults import misled, scaled
from cnnum.lab.reproduce.figure import Curve, Field, Figure, Panel
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.lab.reproduce.setup import MM, NEWTON, E, Z
from cnnum.tactile.halfspace import (
    displacement,
    line_load_stress,
    low_pass,
    rectangle_stress,
    strain,
    strain_energy_density,
    stress,
)

X = np.linspace(-1e-3, 1e-3, 201)
FIELD_FIGURES_DEPTHS = (0.1e-3, 0.2e-3, 0.3e-3, 0.4e-3)
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
                for z in FIELD_FIGURES_DEPTHS
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
    profiles = [stress(X, 0.0, z, NEWTON)[..., 2, 2] for z in FIELD_FIGURES_DEPTHS]
    labels = [f"z = {MM * z:.1f} mm" for z in FIELD_FIGURES_DEPTHS]
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
                   for z, n in zip(FIELD_FIGURES_DEPTHS, labels, strict=True)]),
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
    stress = line_load_stress(x[:, np.newaxis] - places, z[:, np.newaxis, np.newaxis], force)
    return np.asarray(stress[..., 2, 2] @ weights)


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


DEPTHS = np.array([0.1, 0.2, 0.3, 0.4, 0.5]) * 1e-3


def scattered(seed: int = 4) -> tuple[Floats, Floats]:
    """Return (3, 400) places around the load, m, and (3, 400) loads in all directions, N."""
    rng = np.random.default_rng(seed)
    place = np.stack([*rng.uniform(-1e-3, 1e-3, (2, 400)), rng.uniform(1e-5, 1e-3, 400)])
    return place, rng.normal(size=(3, 400))


def largest_gap(ours: Floats, theirs: Floats) -> float:
    """Return the largest difference, as a share of the largest entry of each tensor."""
    axes = tuple(range(theirs.ndim - 1))
    return float((np.abs(ours - theirs).max(axis=axes) / np.abs(theirs).max(axis=axes)).max())


def displacement_gap(nu: float | None) -> float:
    """Return how far our displacement is from (4.9), or at ν = 0.5 from (4.10)."""
    place, load = scattered()
    x, y, z = place
    ratio = 0.5 if nu is None else nu
    ours = displacement(x, y, z, load.T, youngs_modulus=E, poisson=ratio).T
    if nu is None:
        return largest_gap(ours, printed.displacement_of_rubber(place, load, E))
    return largest_gap(ours, printed.displacement(place, load, E, nu))


def stress_gap() -> float:
    """Return how far our stress is from (4.11)."""
    place, load = scattered()
    x, y, z = place
    ours = np.moveaxis(stress(x, y, z, load.T), 0, -1)
    return largest_gap(ours, printed.stress(place, load))


def strain_gap() -> float:
    """Return how far our strain is from (4.12)."""
    place, load = scattered()
    x, y, z = place
    ours = np.moveaxis(strain(x, y, z, load.T, youngs_modulus=E), 0, -1)
    return largest_gap(ours, printed.strain(place, load, E))


def energy_gap() -> float:
    """Return how far our strain energy density is from (4.13), relative to each value."""
    place, load = scattered()
    theirs = printed.energy(place, load, E)
    x, y, z = place
    ours = strain_energy_density(x, y, z, load.T, youngs_modulus=E)
    # points where Qx + Ry + Fz nearly vanishes hold no digits of it
    scale = np.sum(load**2, axis=0) / np.sum(place**2, axis=0) ** 2 / E
    return float((np.abs(ours - theirs) / scale).max())


def sigma(i: int, x: float, z: float = Z) -> float:
    """Return σ_xz (i = 0) or σ_zz (i = 2) at (x, 0, z), Pa."""
    return float(stress(x, 0.0, z, NEWTON)[i, 2])


def epsilon(i: int, x: float, z: float = Z) -> float:
    """Return ε_xz (i = 0) or ε_zz (i = 2) at (x, 0, z)."""
    return float(strain(x, 0.0, z, NEWTON, youngs_modulus=E)[i, 2])


def highest(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where |function| is largest, mm."""
    result = minimize_scalar(
        lambda x: -abs(function(x)), bounds=(low, high), method="bounded", options={"xatol": 1e-12}
    )
    return 1e3 * float(result.x)


def zero_of_strain() -> float:
    """Return where ε_zz changes its sign, mm."""
    return 1e3 * float(brentq(partial(epsilon, 2), 0.1 * Z, 3.0 * Z, xtol=1e-15))


def half_width(function: Callable[[float], float], depth: float = Z) -> float:
    """Return the distance, in depths, at which a distribution has fallen to a half."""
    top = function(0.0)
    return float(brentq(lambda x: function(x * depth) / top - 0.5, 0.0, 5.0, xtol=1e-14))


def decay() -> float:
    """Return the power of depth with which σ_zz below the load falls."""
    peaks = [abs(sigma(2, 0.0, float(z))) for z in DEPTHS]
    return float(np.polyfit(np.log(DEPTHS), np.log(peaks), 1)[0])


def widening() -> float:
    """Return how much wider σ_zz is at 0.4 mm than at 0.2 mm."""
    wide = [half_width(partial(_normal_at, z), z) * z for z in (2 * Z, Z)]
    return wide[0] / wide[1]


def _normal_at(z: float, x: float) -> float:
    return sigma(2, x, z)


def transferred(reach: float) -> float:
    """Return the Hankel transform of σ_zz at kz = reach, of a load of 1 N, by quadrature."""
    wave = reach / Z

    def integrand(rho: float) -> float:
        return rho * sigma(2, rho) * float(j0(wave * rho))

    # beyond 60 z less than 1e-5 of the load is left, and it oscillates
    parts = [quad(integrand, a * Z, (a + 1) * Z, limit=200)[0] for a in range(60)]
    return -2.0 * pi * sum(parts)


def energy_at(x: float) -> float:
    """Return the strain energy density at (x, 0, z)."""
    return float(strain_energy_density(x, 0.0, Z, NEWTON, youngs_modulus=E))


def sinking_at(x: float) -> float:
    """Return u_z at (x, 0, z)."""
    return float(displacement(x, 0.0, Z, NEWTON, youngs_modulus=E)[2])


def strip_gap() -> float:
    """Return how far a long Love rectangle is from the strip of superposed line loads."""
    half, depth = 1e-3, 0.3e-3
    x = np.linspace(-2e-3, 2e-3, 41)
    long = rectangle_stress(x, 0.0, depth, [0.0, 0.0, 1.0], size=(2 * half, 4.0))[..., 2, 2]
    angles = [np.arctan2(depth, x + side * half) for side in (-1.0, 1.0)]
    # integral of Flamant's σ_zz over the strip (Johnson 2.23)
    turn = angles[0] - angles[1]
    strip = -(2 * turn - (np.sin(2 * angles[0]) - np.sin(2 * angles[1]))) / (2 * pi)
    return float(np.abs(long - strip).max())


def flat_gap() -> float:
    """Return how far lines below a rigid flat strip are from its closed form, in mean pressures."""
    x, z = np.linspace(-2.0, 2.0, 81), np.linspace(0.05, 1.5, 30)
    return float(np.abs(flat_strip(x, z) - flat_punch_stress(x, z[:, np.newaxis])).max())


def _equations() -> tuple[Item, ...]:
    exact = "both are formulas in double precision: the rest is rounding"
    return tuple(
        Item(f"eq-{number}", title, f"({number})", 0.0, compute, tolerance, exact,
             faults=(scaled(subject, 1.0 + 1e-9), misled(subject, 2, "z", factor=1.0 + 1e-9)))
        for number, title, compute, tolerance, subject in (
            ("4.9", "displacement at ν = 0.3 against the printed formula",
             partial(displacement_gap, 0.3), 1e-12, displacement),
            ("4.10", "displacement at ν = 0.5 against the printed formula",
             partial(displacement_gap, None), 1e-12, displacement),
            ("4.11", "stress at ν = 0.5 against the printed formula", stress_gap, 1e-12, stress),
            ("4.12", "strain at ν = 0.5 against the printed formula", strain_gap, 1e-12, strain),
            ("4.13", "strain energy density against the printed formula", energy_gap, 1e-12,
             strain_energy_density),
        )
    )  # fmt: skip


# (4.10) at half its peak: (ρ² + 2)/(2 (ρ² + 1)^1.5) = 1/2, a cubic in ρ²
SINKING = sqrt(float(brentq(lambda t: (t + 2) ** 2 - (t + 1) ** 3, 0.0, 3.0, xtol=1e-15)))
FOUND = "the printed formula's own root; found by search on our fields to 1e-9 mm"

CHAPTER = Chapter(
    "Section 4.2 — the elastic half-space",
    (
        *_equations(),
        Item("fig-4.2-normal", "σ_zz 0.2 mm below 1 N", "Fig. 4.2; (4.11) at x = y = 0",
             -3.0 / (2.0 * pi * Z**2) / 1e6, lambda: sigma(2, 0.0) / 1e6, 1e-12,
             "closed form against closed form", "MPa", "relative", figure="fig-4.2",
             faults=(scaled(stress, 1.0 + 1e-9),)),
        Item("fig-4.2-shear", "where |σ_xz| is largest", "Fig. 4.2; (4.11): |x| = z/2",
             0.1, partial(highest, partial(sigma, 0), 0.0, 2 * Z), 1e-6, FOUND, "mm",
             figure="fig-4.2", faults=(misled(stress, 2, "z", factor=1.001),)),
        Item("fig-4.3", "power of depth with which σ_zz falls", "Fig. 4.3; (4.11)",
             -2.0, decay, 1e-9, "a straight line in logarithms: rounding", figure="fig-4.3",
             faults=(misled(stress, 2, "z", shift=1e-9, of=Z),)),
        Item("fig-4.4-width", "width of σ_zz at twice the depth", "Fig. 4.4 (left); (4.11)",
             2.0, widening, 1e-9, "roots found to 1e-14", figure="fig-4.4",
             faults=(misled(stress, 2, "z", shift=1e-9, of=Z),)),
        *(
            Item(f"fig-4.4-filter-{reach}", f"σ_zz passed at wave number {reach}/z",
                 "Fig. 4.4 (right): the transform of (4.11)",
                 (1 + reach) * exp(-reach), partial(transferred, reach), 2e-5,
                 "the integral is cut at 60 z, where 5e-6 of the load is left", figure="fig-4.4",
                 faults=(scaled(stress, 1.001), misled(stress, 2, "z", factor=1.001)))
            for reach in (1, 3)
        ),
        Item("fig-4.5-zero", "where ε_zz is zero", "Fig. 4.5; section 4.3.3: √2 z",
             sqrt(2.0) * 0.2, zero_of_strain, 1e-6, FOUND, "mm", figure="fig-4.5",
             faults=(misled(strain, 2, "z", factor=1.001),)),
        Item("fig-4.5-brim", "where ε_zz has its opposite extremum",
             "Fig. 4.5; section 4.3.3: 2z", 0.4,
             partial(highest, partial(epsilon, 2), 1.5 * Z, 4 * Z), 1e-6, FOUND, "mm",
             figure="fig-4.5", faults=(misled(strain, 2, "z", factor=1.001),)),
        Item("fig-4.6-stress", "half-width of σ_zz, in depths", "Fig. 4.6; (4.11)",
             sqrt(2.0**0.4 - 1.0), partial(half_width, partial(sigma, 2)), 1e-9,
             "root of the printed formula; found to 1e-14", "z", figure="fig-4.6",
             faults=(misled(stress, 2, "z", factor=1.001),)),
        Item("fig-4.6-energy", "half-width of the strain energy density", "Fig. 4.6; (4.13)",
             sqrt(2.0 ** (1.0 / 3.0) - 1.0), partial(half_width, energy_at), 1e-9,
             "root of the printed formula; found to 1e-14", "z", figure="fig-4.6",
             faults=(misled(strain_energy_density, 2, "z", factor=1.001),)),
        Item("fig-4.6-sinking", "half-width of u_z: root of (ρ² + 2)² = (ρ² + 1)³",
             "Fig. 4.6; (4.10)", SINKING,
             partial(half_width, sinking_at), 1e-9, "root of a cubic; found to 1e-14", "z",
             figure="fig-4.6",
             faults=(misled(displacement, 2, "z", factor=1.001),)),
        Item("fig-4.7-strip", "strip of line loads against a long Love rectangle",
             "Fig. 4.7, “integrated from a line load solution”", 0.0, strip_gap, 1e-6,
             "a rectangle 2000 times as long as wide is a strip to the square of that",
             "p", figure="fig-4.7", faults=(scaled(rectangle_stress, 1.0001),)),
        Item("fig-4.7-flat", "stress below a flat rigid strip, lines against its closed form",
             "Fig. 4.7 (top right): “concentrated around the edges”", 0.0, flat_gap, 1e-9,
             "400 lines of Chebyshev's weights converge as exp(−800 z) from 0.05 half-widths on",
             "mean p", figure="fig-4.7",
             faults=(scaled(line_load_stress, 1.0001),
                     misled(line_load_stress, 1, "z", factor=1.0001))),
    ),
    FIGURES,
)  # fmt: skip
