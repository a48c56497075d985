"""What taxels feel of a sphere, against waves; its radius and its turn, against the simulation."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import j1

from cnnum.drivers.simulated.cover import Layout
from cnnum.drivers.simulated.influence import influence_of
from cnnum.drivers.simulated.script import Phase
from cnnum.drivers.simulated.settings import Settings
from cnnum.engine import Engine
from cnnum.errors import PhysicsError, UnknownNameError
from cnnum.programs import program
from cnnum.programs.fields import where
from cnnum.tactile.bumps_felt import bumps_felt
from cnnum.tactile.contact import contact_modulus, hertz
from cnnum.tactile.indenters import Disc
from cnnum.templates.tactile.contact_mechanics.contact_radius import round_under
from cnnum.templates.tactile.contact_mechanics.contact_wrench import place_of, sideways_on
from cnnum.templates.tactile.contact_mechanics.sphere_response import (
    pushed_by,
    turned_by,
)
from cnnum.templates.tactile.shared.loads import loads_of, patch_of
from cnnum.templates.tactile.twist import twist

SIZES = [(0.8, 0.47), (1.3, 0.67), (1.8, 1.33)]
AWAY = np.linspace(0.05, 4.0, 64)
"""Pitches from the axis at which maps are compared."""


def felt(radius, depth, away=AWAY, reads="strain"):
    """Return the program's maps at 64 distances, in float64."""

    @program
    def seen(frame):
        """All maps of `sphere`."""
        a = frame.shear_x.max()
        pushed = pushed_by(frame.normal, a, depth, reads)
        names = ("signal", "by_radius", "by_away")
        maps = {n: getattr(pushed, n) for n in names}
        return {**maps, "turned": turned_by(frame.normal, a, depth)}

    plan = Engine("reference").compile(seen, (8, 8), channels=("shear_x", "normal"))
    frame = np.stack([np.full(64, radius), away**2], axis=-1).reshape(8, 8, 2)
    return {name: np.ravel(v) for name, v in plan.stream(()).push(frame).items()}


@pytest.mark.parametrize(("radius", "depth"), SIZES)
def test_pressed_as_its_waves_add_up_to(radius, depth):
    """The arc sine is good to 7e-5, and a mean pressure of 1 is a largest one of 1.5 (Hertz)."""
    true = Disc(radius, (0.0, 0.0), "hertz").normal(AWAY, 0.0 * AWAY, depth, "strain") / 1.5
    assert np.abs(felt(radius, depth)["signal"] - true).max() <= 7e-5 * depth / radius + 1e-6
    # stress needs no arc sine
    true = Disc(radius, (0.0, 0.0), "hertz").normal(AWAY, 0.0 * AWAY, depth, "stress") / 1.5
    assert np.abs(felt(radius, depth, reads="stress")["signal"] - true).max() <= 1e-6


@pytest.mark.parametrize(("reads", "within"), [("strain", 5e-4), ("stress", 1e-5)])
@pytest.mark.parametrize(("radius", "depth"), SIZES)
def test_slopes_are_those_of_the_map(radius, depth, reads, within):
    """Central differences, good to 2e-6; the arc sine's ripple tilts strain by up to 3e-4."""
    got, step = felt(radius, depth, reads=reads), 1e-3
    wide, slim = (felt(radius + s * step, depth, reads=reads)["signal"] for s in (1, -1))
    assert got["by_radius"] == pytest.approx((wide - slim) / (2 * step), abs=within)
    ways = (np.sqrt(AWAY**2 + s * step) for s in (1, -1))
    out, back = (felt(radius, depth, way, reads)["signal"] for way in ways)
    assert got["by_away"] == pytest.approx((out - back) / (2 * step), abs=within)


@pytest.mark.parametrize(("radius", "depth"), SIZES)
def test_turned_as_its_waves_add_up_to(radius, depth):
    """Reissner and Sagoci's traction is (2/π) (sin ka − ka cos ka)/k of J₁(kρ) for each radian."""

    def wave(k, rho):
        return (
            (np.sin(k * radius) / k - radius * np.cos(k * radius))
            * np.exp(-k * depth)
            * j1(k * rho)
        )

    true = [
        2 / np.pi * rho * quad(wave, 0.0, 40.0 / depth, args=(rho,), limit=500)[0]
        for rho in AWAY[::9]
    ]
    # the quadrature's own tolerance
    assert felt(radius, depth)["turned"][::9] == pytest.approx(true, abs=1e-7)


@program
def measured(frame):
    """The contact's radius, nothing acting sideways."""
    contact = place_of(*(lambda loads: (loads, patch_of(loads)))(loads_of(frame, -1.0)))
    return {"radius": round_under(contact, (0.0 * contact.spread,), 1.0 / 1.5).radius}


@pytest.mark.parametrize("start", [(0.0, 0.0), (-0.9e-3, -0.4e-3), (0.4e-3, 0.7e-3)])
def test_radius_of_a_contact_wherever_it_is(fast, run, simulate, start):
    """Within 2 %, so that its cube is within 6 %: the simulation's own cells are 0.2 pitches."""
    script = (Phase("hold", 0.2), Phase("press", 0.2, load=0.8), Phase("hold", 0.3))
    strain, _ = simulate(script=script, seed=3, start=start)
    modulus = contact_modulus(Settings().youngs_modulus, 0.5)
    true = float(hertz(0.8, Settings().radius, modulus).contact_radius) / Settings().pitch
    got = run(fast, measured, strain, ["radius"])["radius"]
    assert got[-20:] == pytest.approx(true, rel=0.02)


def seen_on_bumps(depth):
    """Return a program that tells the contact's radius on bumps, nothing acting sideways."""
    bumps = bumps_felt("bumps-fem", depth, 0.4)

    @program
    def radius(frame):
        """The radius alone."""
        loads = loads_of(frame, -1.0)
        contact = place_of(loads, patch_of(loads))
        return {"radius": round_under(contact, (0.0 * contact.spread,), depth, bumps).radius}

    return radius


def test_radius_on_bumps_beyond_whose_reach_taxels_read(fast, run, simulate):
    """Within 2 %, as on a flat cover; taxels of a large array under a thick cover read 1 % of the
    largest load where the kernels of bumps end, by which it was 5 % too large."""
    script = (Phase("hold", 0.2), Phase("press", 0.2, load=0.5), Phase("hold", 0.2))
    options = {"thickness": 2e-3, "shape": (16, 16), "cover": "bumps-fem", "seed": 3}
    strain, truth = simulate(script=script, **options)
    got = run(fast, seen_on_bumps(2.0 / 1.5), strain, ["radius"])["radius"]
    true = truth["contact_radius"][-1] / Settings().pitch
    assert got[-20:] == pytest.approx(true, rel=0.02)


@program
def felt_beside(frame):
    """The contact's radius, and whether something seems to act sideways."""
    loads = loads_of(frame, -1.0)
    contact = place_of(loads, patch_of(loads))
    place = round_under(contact, sideways_on(contact), 1.0 / 1.5)
    return {"radius": place.radius, "sheared": where(place.sheared, 1.0, 0.0)}


@pytest.mark.parametrize("dead", [(4, 2), (3, 4)])
def test_a_press_beside_a_dead_taxel_is_no_shear(fast, run, simulate, dead):
    """As more and more taxels feel the contact, the one that is missing leaves their shear
    unbalanced; taken for a force, it would keep the radius from being followed, to 8 % less."""
    script = (Phase("hold", 0.2), Phase("press", 0.4, load=1.1), Phase("hold", 0.2))
    strain, truth = simulate(script=script, seed=3, rate=500.0, start=(-0.1e-3, 0.15e-3))
    strain[:, dead[0], dead[1]] = 0.0
    got = run(fast, felt_beside, strain)
    assert not got["sheared"][-20:].any()
    true = truth["contact_radius"][-1] / Settings().pitch
    assert got["radius"][-20:] == pytest.approx(true, rel=0.02)


@pytest.mark.parametrize(
    ("thickness", "shape", "angle", "load"),
    [(0.7e-3, (8, 8), 0.2, 0.5), (1.4e-3, (8, 8), -0.12, 0.9), (2.0e-3, (16, 16), 0.3, 0.7)],
)
def test_rate_of_a_twist(fast, run, simulate, thickness, shape, angle, load):
    """Within 10 % once half the radius slips, at 2.5 mV of noise and 200 frames a second."""
    lasts = 0.6
    script = (
        Phase("hold", 0.2),
        Phase("press", 0.3, load=load),
        Phase("hold", 0.3),
        Phase("twist", lasts, angle=angle),
    )
    strain, truth = simulate(script=script, thickness=thickness, shape=shape, seed=5)
    bound = twist.bind(depth=thickness / 1.5e-3)
    got = run(fast, bound, strain, ["twist", "twist_rate"])
    turned = got["twist"] > 0
    assert turned.any()
    assert np.median(got["twist_rate"][turned]) == pytest.approx(angle / lasts, rel=0.1)
    assert truth["twist_rate"][-1] == pytest.approx(angle / lasts)


@pytest.mark.parametrize("cover", ["bumpy", "bumps-fem"])
def test_rate_of_a_twist_on_bumps(fast, run, simulate, cover):
    """Within 10 % where the program is told of the bumps, and nearer than without."""
    script = (
        Phase("hold", 0.2),
        Phase("press", 0.3, load=0.9),
        Phase("hold", 0.3),
        Phase("twist", 0.6, angle=0.2),
    )
    strain, _ = simulate(script=script, cover=cover, seed=7)
    off = []
    for told in (cover, "flat"):
        bound = twist.bind(depth=1.0 / 1.5, cover=told, bump=0.4)
        got = run(fast, bound, strain, ["twist", "twist_rate"])
        found = np.median(got["twist_rate"][got["twist"] > 0])
        off.append(abs(found / (0.2 / 0.6) - 1.0))
    assert off[0] <= 0.1
    assert off[0] < off[1]


@pytest.mark.parametrize("cover", ["bumpy", "bumps-fem"])
def test_bumps_are_those_of_the_simulation(cover):
    """Finite elements to rounding; an even foot of many cells is within 3 % of one of 13."""
    layout = Layout((9, 9), 1.5e-3)
    settings = Settings(cover=cover, shape=(9, 9))
    influence = influence_of(settings, layout)
    # a load on any cell of the middle square is taken by its bump, as 25 cells make one square
    middle = -influence[:, :, 27, 27] * 25 * settings.youngs_modulus / 3.0
    felt = bumps_felt(cover, 1.0 / 1.5, 0.4)
    share = 1e-9 if cover == "bumps-fem" else 0.035
    for got, true in (
        (felt.normal, middle[..., 2, 2]),
        (felt.shear[0, 0], middle[..., 0, 0]),
        (felt.shear[1, 0], middle[..., 1, 0]),
    ):
        assert np.abs(got - true).max() <= share * np.abs(true).max()


@pytest.mark.parametrize(("cover", "depth", "radius"), [("bumpy", 0.0, 0.4), ("bumpy", 0.5, 0.6)])
def test_bumps_that_are_none(cover, depth, radius):
    with pytest.raises(PhysicsError, match="expected"):
        bumps_felt(cover, depth, radius)


def test_covers_that_are_none(fast):
    with pytest.raises(UnknownNameError, match="felt"):
        fast.compile(twist.bind(cover="felt"), (4, 4))
