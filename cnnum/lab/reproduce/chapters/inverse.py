"""Section 5.2: the inverse of the point load, equation by equation.

The library's inverse is compared with the printed equations on signals drawn at random: they come
from no forward model, so neither side can lean on one.
"""

from functools import partial
from math import sqrt

import numpy as np

from cnnum.arrays import Floats
from cnnum.lab.reproduce.chapters import printed
from cnnum.lab.reproduce.faults import Fault, scaled
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.lab.reproduce.setup import E, Z, covered_taxel
from cnnum.tactile.halfspace import strain, stress
from cnnum.tactile.inverse import (
    PointLoad,
    force_from_moments,
    locate,
    locate_load,
    locate_signals,
    locate_stress,
)
from cnnum.tactile.taxel import Coupling
from cnnum.tactile.taxel.bridge import COMBINE

RING = sqrt(2.0) * Z
LOADS = 300


def places(inner: float, outer: float, seed: int = 5) -> tuple[Floats, Floats]:
    """Return x and y of random loads between two radii, m."""
    rng = np.random.default_rng(seed)
    rho, turn = rng.uniform(inner, outer, LOADS), rng.uniform(0.0, 2.0 * np.pi, LOADS)
    return rho * np.cos(turn), rho * np.sin(turn)


def seen(x: Floats, y: Floats, force: float = 1e-3) -> Floats:
    """Return (n, 3) ε_xz, ε_yz, ε_zz at the place (x, y) from a normal load, as in (4.16)."""
    return strain(x, y, Z, [0.0, 0.0, force], youngs_modulus=E)[..., 2]


def drawn(far: bool, seed: int = 31) -> Floats:
    """Return (n, 3) strains of random sizes and directions, of loads outside the ring or inside."""
    rng = np.random.default_rng(seed)
    turn, size = rng.uniform(0.0, 2.0 * np.pi, LOADS), 10.0 ** rng.uniform(-6.0, -1.0, LOADS)
    ratio = rng.uniform(0.1, 8.0, LOADS)  # of shear to normal strain: A
    normal = size if far else -size
    return np.stack([ratio * size * np.cos(turn), ratio * size * np.sin(turn), normal], axis=-1)


def both() -> Floats:
    """Return drawn strains of both kinds."""
    return np.concatenate([drawn(False), drawn(True)])


def located(rows: Floats) -> PointLoad:
    """Return the library's load for strains."""
    return locate(rows, depth=Z, youngs_modulus=E)


def radius(load: PointLoad) -> Floats:
    """Return its distance from the taxel."""
    return np.asarray(np.hypot(load.x, load.y))


def angle_gap() -> float:
    """Return the largest difference of the angle from that of (5.1), rad."""
    rows = both()
    load = located(rows)
    # the print's (x, y) is the taxel's place from the load, ours the load's from the taxel
    turn = np.arctan2(-load.y, -load.x) - np.arctan2(-rows[:, 1], -rows[:, 0])
    return float(np.abs(np.angle(np.exp(1j * turn))).max())


def ratio_gap() -> float:
    """Return the largest relative difference of A² at our place from A² of the strains, (5.2)."""
    rows = both()
    ours = printed.ratio_squared_at(radius(located(rows)), Z)
    return float(np.abs(ours / printed.ratio_squared(*rows.T) - 1.0).max())


def roots_gap() -> float:
    """Return the largest relative difference of ρ from the roots of (5.3)."""
    gaps: list[float] = []
    for far in (True, False):
        rows = drawn(far)
        squared = printed.both_roots(printed.ratio_squared(*rows.T), Z)[0 if far else 1]
        gaps.append(float(np.abs(radius(located(rows)) / np.sqrt(squared) - 1.0).max()))
    return max(gaps)


def radius_gap(far: bool) -> float:
    """Return the largest relative difference of ρ from (5.4), or from (5.5) outside the ring."""
    rows = drawn(far)
    formula = printed.outside if far else printed.inside
    squared = formula(printed.ratio_squared(*rows.T), Z)
    return float(np.abs(radius(located(rows)) / np.sqrt(squared) - 1.0).max())


def place_gap() -> float:
    """Return our largest error of the place (5.6), in depths, anywhere."""
    x, y = places(0.0, 4.0 * Z)
    load = locate(seen(-x, -y), depth=Z, youngs_modulus=E)
    return float(np.hypot(load.x - x, load.y - y).max() / Z)


def force_gap() -> float:
    """Return the largest relative difference of F from (5.7), at the place of (5.4)."""
    rows = drawn(False)
    rho = np.sqrt(printed.inside(printed.ratio_squared(*rows.T), Z))
    theirs = printed.normal_force(rows[:, 2], rho, Z, E)
    return float(np.abs(located(rows).force / theirs - 1.0).max())


def moment_gap() -> float:
    """Return the largest error of Qx + Ry + Fz of loads in all directions, as a share of Fz."""
    x, y = places(0.02 * Z, 4.0 * Z)
    rng = np.random.default_rng(8)
    # with |Qx + Ry| below Fz, so that the taxel sees a push
    load = np.stack([*rng.uniform(-0.15, 0.15, (2, LOADS)), np.ones(LOADS)], axis=-1)
    rows = strain(-x, -y, Z, load, youngs_modulus=E)[..., 2]
    true = -load[:, 0] * x - load[:, 1] * y + load[:, 2] * Z
    return float(np.abs(located(rows).moment - true).max() / Z)


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


def three_gap() -> float:
    """Return the largest difference of (Q, R, F) from (5.13), of three random moments."""
    x, y, _, _ = triples()
    moments = np.random.default_rng(14).normal(size=(3, LOADS)) * Z
    result = force_from_moments(np.stack([x.T, y.T], axis=-1), moments.T, depth=Z)
    theirs = printed.three_taxels(x, y, moments, Z).T
    return float((np.abs(result - theirs).max(axis=-1) / np.abs(theirs).max(axis=-1)).max())


def array_gap() -> float:
    """Return the largest error of place and force from the strain of a 2 × 2 array."""
    rng = np.random.default_rng(13)
    pitch = 1.2 * Z
    taxels = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * pitch
    spot = rng.uniform(0.0, pitch, (60, 2))
    load = np.concatenate([rng.uniform(-0.5, 0.5, (60, 2)), np.ones((60, 1))], axis=-1)
    offset = taxels - spot[:, np.newaxis]
    rows = strain(offset[..., 0], offset[..., 1], Z, load[:, np.newaxis], youngs_modulus=E)
    result = locate_load(rows[..., 2], taxels, depth=Z, youngs_modulus=E)
    place = np.hypot(result.x - spot[:, 0], result.y - spot[:, 1]) / Z
    return float(max(place.max(), np.abs(result.force - load).max()))


def sensitivity_gap() -> float:
    """Return the largest relative difference of ρ from (5.15), of signals with many β_ns."""
    signals = -drawn(False)
    measured = (signals[:, 0] ** 2 + signals[:, 1] ** 2) / signals[:, 2] ** 2
    gaps: list[float] = []
    for beta in (0.5, 1.0, 1.5, 3.0):
        load = locate_signals(signals, depth=Z, youngs_modulus=E, alpha_normal=1.0, beta_ns=beta)
        theirs = np.sqrt(printed.with_sensitivity(measured, beta, Z))
        gaps.append(float(np.abs(radius(load) / theirs - 1.0).max()))
    return max(gaps)


def signal_ratio_gap() -> float:
    """Return the largest relative difference of β² A_m² of a whole taxel's signals and A²."""
    x, y = places(0.02 * Z, 0.95 * RING)
    taxel = covered_taxel(1.5)
    volts = taxel.bridge.voltages(taxel.coupling.force(seen(-x, -y)))
    t_x, t_y, s_n = COMBINE @ volts.T
    measured = 1.5**2 * (t_x**2 + t_y**2) / s_n**2
    return float(np.abs(measured / printed.ratio_squared_at(np.hypot(x, y), Z) - 1.0).max())


ROUNDING = "rounding, amplified a hundredfold near √2 z"
CANCELS = "rounding; the printed root cancels for small A"
PLACE = (scaled(locate, 1.0 + 1e-6, part="x"), scaled(locate, 1.0 + 1e-6, part="y"))


def _exact() -> tuple[Item, ...]:
    """Return the items whose exact answer is known: the rest is an error."""
    along_x = (scaled(locate, -1.0, part="x"), *PLACE)
    rows: tuple[tuple[str, str, str, object, float, str, str, tuple[Fault, ...]], ...] = (
        ("eq-5.1", "angle of the load from two shears", "(5.1)", angle_gap, 1e-12, "rounding",
         "rad", along_x),
        ("eq-5.2", "A² at the place found against A² of the strains", "(5.2)", ratio_gap, 1e-9,
         ROUNDING, "relative", PLACE),
        ("eq-5.3", "distance against the two roots", "(5.3)", roots_gap, 1e-9, CANCELS,
         "relative", PLACE),
        ("eq-5.4", "distance inside √2 z", "(5.4)", partial(radius_gap, False), 1e-9, CANCELS,
         "relative", PLACE),
        ("eq-5.5", "distance outside √2 z", "(5.5)", partial(radius_gap, True), 1e-9, ROUNDING,
         "relative", PLACE),
        ("eq-5.6", "place of exact loads, by our one signed root", "(5.6)", place_gap, 1e-9,
         "exact data: rounding, anywhere within 4 z", "z",
         (*along_x, scaled(strain, 1.0 + 1e-6, entry=(2, 2)))),
        ("eq-5.7", "force inside √2 z", "(5.7)", force_gap, 1e-9, ROUNDING, "relative",
         (scaled(locate, 1.0 + 1e-6, part="force"),)),
        ("eq-5.7-ring", "place and force on the ring, where (5.7) divides by zero",
         "(5.4)–(5.7)", on_the_ring, 1e-9, "exact data: rounding", "relative",
         (scaled(locate, 1.0 + 1e-6, part="force"), *PLACE)),
        ("eq-5.8", "Qx + Ry + Fz of loads in all directions", "(5.8)", moment_gap, 1e-9,
         "exact data: rounding", "N z", (scaled(locate, 1.0 + 1e-6, part="moment"),)),
        ("eq-5.10", "place from a stress sensor", "(5.9), (5.10)", stress_place_gap, 1e-12,
         "exact data, no singular ring: rounding", "z",
         (scaled(locate_stress, 1.0 + 1e-6, part="x"), scaled(stress, 1.0 + 1e-6, entry=(2, 2)))),
        ("eq-5.12", "place and 3-D load from the strains of a 2 × 2 array", "(5.12)", array_gap,
         1e-6, "exact data; the fit ends at the rounding of its squares", "N, z",
         (scaled(locate_load, 1.0 + 1e-4, part="force"), scaled(locate_load, 1.001, part="x"))),
        ("eq-5.13", "3-D load from three moments", "(5.13)", three_gap, 1e-9,
         "rounding, amplified where the three taxels are near a line", "relative",
         (scaled(force_from_moments, -1.0, entry=0),
          scaled(force_from_moments, 1.0 + 1e-6, entry=2))),
        ("eq-5.14", "β_ns² A_m² from the four bridges of a taxel against A²", "(5.14)",
         signal_ratio_gap, 1e-11, ROUNDING, "relative",
         (scaled(Coupling.force, 1.0 + 1e-6, entry=2),)),
        ("eq-5.15", "distance from signals, β_ns from 0.5 to 3", "(5.15)", sensitivity_gap, 1e-9,
         CANCELS, "relative",
         (scaled(locate_signals, 1.0 + 1e-6, part="x"),
          scaled(locate_signals, 1.0 + 1e-6, part="y"))),
    )  # fmt: skip
    return tuple(
        Item(name, title, source, 0.0, compute, tolerance, reason, unit, faults=faults)  # type: ignore[arg-type]
        for name, title, source, compute, tolerance, reason, unit, faults in rows
    )


CHAPTER = Chapter("Section 5.2 — the inverse of the point load", _exact(), {})
