"""Section 5.2: the inverse of the point load, equation by equation."""

from functools import partial
from math import sqrt

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.chapters import printed
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.lab.reproduce.setup import E, Z, covered_taxel
from cnnum.tactile.halfspace import strain, stress
from cnnum.tactile.inverse import (
    force_from_moments,
    largest_spacing,
    locate,
    locate_load,
    locate_signals,
    locate_stress,
)
from cnnum.tactile.taxel.signals import COMBINE

RING = sqrt(2.0) * Z
LOADS = 300


def places(inner: float, outer: float, seed: int = 5) -> tuple[Floats, Floats]:
    """Return x and y of random loads between two radii, m."""
    rng = np.random.default_rng(seed)
    rho, turn = rng.uniform(inner, outer, LOADS), rng.uniform(0.0, 2.0 * np.pi, LOADS)
    return rho * np.cos(turn), rho * np.sin(turn)


def inside() -> tuple[Floats, Floats]:
    """Return places well inside the ring."""
    return places(0.02 * Z, 0.95 * RING)


def outside() -> tuple[Floats, Floats]:
    """Return places well outside the ring."""
    return places(1.05 * RING, 4.0 * Z)


def seen(x: Floats, y: Floats, force: float = 1e-3) -> Floats:
    """Return (n, 3) ε_xz, ε_yz, ε_zz at the place (x, y) from a normal load, as in (4.16)."""
    return strain(x, y, Z, [0.0, 0.0, force], youngs_modulus=E)[..., 2]


def angle_gap() -> float:
    """Return the largest error of the angle from (5.1), rad."""
    x, y = places(0.02 * Z, 4.0 * Z)
    rows = seen(x, y)
    turn = np.arctan2(-rows[:, 1], -rows[:, 0]) - np.arctan2(y, x)
    return float(np.abs(np.angle(np.exp(1j * turn))).max())


def ratio_gap() -> float:
    """Return the largest relative difference of the two forms of A² in (5.2)."""
    x, y = inside()
    ours = printed.ratio_squared(*seen(x, y).T)
    return float(np.abs(ours / printed.ratio_squared_at(np.hypot(x, y), Z) - 1.0).max())


def roots_gap() -> float:
    """Return the largest relative error of ρ from the two roots of (5.3)."""
    gaps: list[float] = []
    for which, (x, y) in enumerate((outside(), inside())):
        squared = printed.both_roots(printed.ratio_squared(*seen(x, y).T), Z)[which]
        gaps.append(float(np.abs(np.sqrt(squared) / np.hypot(x, y) - 1.0).max()))
    return max(gaps)


def radius_gap(far: bool) -> float:
    """Return the largest relative error of ρ from (5.4), or from (5.5) outside the ring."""
    x, y = outside() if far else inside()
    formula = printed.outside if far else printed.inside
    squared = formula(printed.ratio_squared(*seen(x, y).T), Z)
    return float(np.abs(np.sqrt(squared) / np.hypot(x, y) - 1.0).max())


def place_gap() -> float:
    """Return our largest error of the place (5.6), in depths, anywhere."""
    x, y = places(0.0, 4.0 * Z)
    load = locate(seen(-x, -y), depth=Z, youngs_modulus=E)
    return float(np.hypot(load.x - x, load.y - y).max() / Z)


def force_gap(ours: bool) -> float:
    """Return the largest relative error of F, ours or by the printed (5.7)."""
    x, y = inside()
    rows = seen(x, y, 2e-3)
    if ours:
        force = locate(rows, depth=Z, youngs_modulus=E).force
    else:
        force = printed.normal_force(rows[:, 2], np.hypot(x, y), Z, E)
    return float(np.abs(force / 2e-3 - 1.0).max())


def moment_gap() -> float:
    """Return the largest error of Qx + Ry + Fz from the printed (5.8) for loads all ways."""
    x, y = inside()
    load = np.random.default_rng(8).normal(size=(LOADS, 3))
    rows = strain(x, y, Z, load, youngs_modulus=E)[..., 2]
    theirs = printed.moment(rows[:, 2], np.hypot(x, y), Z, E)
    return float(np.abs(theirs - (load[:, 0] * x + load[:, 1] * y + load[:, 2] * Z)).max() / Z)


def stress_gap() -> float:
    """Return how far our stress at a taxel is from (5.9), share of the largest."""
    x, y = places(0.0, 4.0 * Z)
    load = np.random.default_rng(9).normal(size=(LOADS, 3))
    lever = load[:, 0] * x + load[:, 1] * y + load[:, 2] * Z
    scale = 3.0 * lever / (2.0 * np.pi * (x**2 + y**2 + Z**2) ** 2.5)
    theirs = scale[:, None] * np.stack([-x * Z, -y * Z, np.full(LOADS, -(Z**2))], axis=-1)
    ours = stress(x, y, Z, load)[..., 2]
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


def stress_place_gap() -> float:
    """Return our largest error of the place from a stress sensor (5.10), in depths."""
    x, y = places(0.0, 4.0 * Z)
    load = locate_stress(stress(-x, -y, Z, [0.0, 0.0, 1e-3])[..., 2], depth=Z)
    return float(np.hypot(load.x - x, load.y - y).max() / Z)


def on_the_ring() -> float:
    """Return our largest error of place and force where (5.7) divides by zero."""
    x, y = places(RING, RING)
    load = locate(seen(-x, -y), depth=Z, youngs_modulus=E)
    gaps = np.hypot(load.x - x, load.y - y) / Z, np.abs(load.force / 1e-3 - 1.0)
    return float(np.maximum(*gaps).max())


def triples() -> tuple[Floats, Floats, Floats, Floats]:
    """Return x, y (3, n) of three taxels around a load, the loads (n, 3) and the moments."""
    rng = np.random.default_rng(12)
    x = np.stack([np.full(LOADS, k) for k in (0.0, 1.0, 0.0)]) * Z - rng.uniform(0, Z, LOADS)
    y = np.stack([np.full(LOADS, k) for k in (0.0, 0.0, 1.0)]) * Z - rng.uniform(0, Z, LOADS)
    load = rng.normal(size=(LOADS, 3))
    return x, y, load, load[:, 0] * x + load[:, 1] * y + load[:, 2] * Z


def three_gap(ours: bool) -> float:
    """Return the largest error of (Q, R, F) from three moments, ours or by (5.13)."""
    x, y, load, moments = triples()
    if ours:
        offsets = np.stack([x.T, y.T], axis=-1)
        found = force_from_moments(offsets, moments.T, depth=Z)
    else:
        found = printed.three_taxels(x, y, moments, Z).T
    return float(np.abs(found - load).max())


def array_gap() -> float:
    """Return the largest error of place and force from the strain of a 2 × 2 array."""
    rng = np.random.default_rng(13)
    pitch = 1.2 * Z
    taxels = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * pitch
    spot = rng.uniform(0.0, pitch, (60, 2))
    load = np.concatenate([rng.uniform(-0.5, 0.5, (60, 2)), np.ones((60, 1))], axis=-1)
    offset = taxels - spot[:, np.newaxis]
    rows = strain(offset[..., 0], offset[..., 1], Z, load[:, np.newaxis], youngs_modulus=E)
    found = locate_load(rows[..., 2], taxels, depth=Z, youngs_modulus=E)
    place = np.hypot(found.x - spot[:, 0], found.y - spot[:, 1]) / Z
    return float(max(place.max(), np.abs(found.force - load).max()))


def sensitivity_gap(ours: bool) -> float:
    """Return the largest error of ρ (in depths) from signals with β_ns = 1.5, (5.14)–(5.15)."""
    x, y = inside()
    rows = seen(-x, -y)
    signals = -rows / np.array([1.5, 1.5, 1.0])
    if ours:
        load = locate_signals(signals, depth=Z, youngs_modulus=E, alpha_normal=1.0, beta_ns=1.5)
        return float(np.hypot(load.x - x, load.y - y).max() / Z)
    measured = (signals[:, 0] ** 2 + signals[:, 1] ** 2) / signals[:, 2] ** 2
    radius = np.sqrt(printed.with_sensitivity(measured, 1.5, Z))
    return float(np.abs(radius - np.hypot(x, y)).max() / Z)


def signal_ratio_gap() -> float:
    """Return the largest relative difference of β² A_m² of a whole taxel's signals and A²."""
    x, y = inside()
    taxel = covered_taxel(1.5)
    volts = taxel.bridge.voltages(taxel.coupling.force(seen(-x, -y)))
    t_x, t_y, s_n = COMBINE @ volts.T
    measured = 1.5**2 * (t_x**2 + t_y**2) / s_n**2
    return float(np.abs(measured / printed.ratio_squared_at(np.hypot(x, y), Z) - 1.0).max())


def spacing() -> float:
    """Return our largest pitch with three taxels inside √2 z of any load, in depths."""
    return float(largest_spacing(Z) / Z)


ROUNDING = "exact data: rounding, amplified a hundredfold near √2 z"


def _exact() -> tuple[Item, ...]:
    """Return the items whose exact answer is known: the rest is an error."""
    return tuple(
        Item(name, title, source, 0.0, compute, tolerance, reason, unit)
        for name, title, source, compute, tolerance, reason, unit in (
            ("eq-5.1", "angle of the load from two shears", "(5.1)", angle_gap, 1e-12,
             "exact data: rounding", "rad"),
            ("eq-5.2", "A² from strains against A² from the place", "(5.2)", ratio_gap, 1e-11,
             ROUNDING, "relative"),
            ("eq-5.3", "ρ from the two roots", "(5.3)", roots_gap, 1e-9,
             "exact data; the printed root cancels for small A", "relative"),
            ("eq-5.4", "ρ inside √2 z", "(5.4)", partial(radius_gap, False), 1e-9,
             "exact data; the printed form cancels for small A", "relative"),
            ("eq-5.5", "ρ outside √2 z", "(5.5)", partial(radius_gap, True), 1e-9,
             ROUNDING, "relative"),
            ("eq-5.6", "place of the load, by our one signed root", "(5.6)", place_gap, 1e-9,
             "exact data: rounding, anywhere within 4 z", "z"),
            ("eq-5.7", "force by the printed formula", "(5.7)", partial(force_gap, False),
             1e-11, ROUNDING, "relative"),
            ("eq-5.7-ours", "force from all three strains at once", "(5.7)",
             partial(force_gap, True), 1e-11, ROUNDING, "relative"),
            ("eq-5.7-ring", "place and force on the ring, where (5.7) divides by zero",
             "(5.4)–(5.7)", on_the_ring, 1e-9, "exact data: rounding", "relative"),
            ("eq-5.8", "Qx + Ry + Fz of loads in all directions", "(5.8)", moment_gap, 1e-10,
             ROUNDING, "N z"),
            ("eq-5.9", "stress at a taxel", "(5.9)", stress_gap, 1e-12,
             "closed form against closed form", "relative"),
            ("eq-5.10", "place from a stress sensor", "(5.10)", stress_place_gap, 1e-12,
             "exact data, no singular ring: rounding", "z"),
            ("eq-5.12", "place and 3-D load from the strains of a 2 × 2 array", "(5.12)",
             array_gap, 1e-6, "exact data; the fit ends at the rounding of its squares", "N, z"),
            ("eq-5.13", "3-D load from three moments, printed formula", "(5.13)",
             partial(three_gap, False), 1e-11, "exact data: rounding", "N"),
            ("eq-5.13-ours", "3-D load from three moments, least squares", "(5.13)",
             partial(three_gap, True), 1e-11, "exact data: rounding", "N"),
            ("eq-5.14", "β_ns² A_m² from the four bridges of a taxel against A²", "(5.14)",
             signal_ratio_gap, 1e-11, ROUNDING, "relative"),
            ("eq-5.15", "ρ from signals with β_ns = 1.5, printed formula", "(5.15)",
             partial(sensitivity_gap, False), 1e-9,
             "exact data; the printed form cancels for small A", "z"),
            ("eq-5.15-ours", "place from signals with β_ns = 1.5", "(5.15)",
             partial(sensitivity_gap, True), 1e-9, "exact data: rounding", "z"),
        )
    )  # fmt: skip


CHAPTER = Chapter(
    "Section 5.2 — the inverse of the point load",
    (
        *_exact(),
        Item("eq-5.11", "pitch at which three taxels always see a load inside √2 z", "(5.11)",
             (1.0 + sqrt(2.0)) / 2.0, spacing, 0.0,
             "the printed bound is sufficient: the true one must not be below it", "z",
             "at least"),
    ),
    {},
)  # fmt: skip
