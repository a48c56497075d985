"""How far a contact has moved, against the simulation's own place of it."""

import numpy as np
import pytest

from cnnum.drivers.simulated.script import Phase
from cnnum.engine import Engine
from cnnum.programs import program
from cnnum.templates.tactile.contact_mechanics.contact_shift import Rest, moves_on
from cnnum.templates.tactile.contact_mechanics.contact_wrench import force_on, place_of
from cnnum.templates.tactile.contact_mechanics.growth_laws import pull_law
from cnnum.templates.tactile.shared.loads import PUSH, loads_of, patch_of
from cnnum.templates.tactile.slip import slip

HELD = (Phase("hold", 0.3), Phase("press", 0.3, load=0.8), Phase("hold", 0.3))
PITCH = 1.5e-3


@program
def way(frame):
    """The way, its noise, and what it makes of the hypotheses whose time is over."""
    loads = loads_of(frame, PUSH)
    force = force_on(place_of(loads, patch_of(loads)), lambda _: pull_law())
    rest = Rest(loads)
    found = rest.way(force.growth, force.normal, loads.normal_noise)
    moves = moves_on(loads, force.growth, found, force.growth.size / force.normal)
    grows, weights = force.growth.grows, force.growth.found
    rest.learn(force.close(grows & ~grows))
    return {
        "along": found.along,
        "noise": found.noise,
        "grows": grows,
        "over": weights.passed,
        "against_stops": moves.against_stops,
        "against_growth": moves.against_growth,
    }


@pytest.mark.parametrize(
    "options",
    [{}, {"shape": (4, 4), "thickness": 2.0e-3}, {"cover": "bumps-fem"}],
    ids=["flat", "4x4", "bumps"],
)
def test_way_is_that_of_the_contact(numba, run, simulate, options):
    """While it slips. Taxels 1.5 mm apart know a slope by differences: over 314 tuning pulls nine
    of ten ways are 0.87 to 1.58 of the true one.
    """
    direction = np.array([np.cos(0.7), np.sin(0.7)])
    script = (*HELD, Phase("pull", 0.4, speed=1.2e-3, direction=0.7))
    strain, truth = simulate(
        script=script, seed=51, rate=100.0, start=tuple(-0.3e-3 * direction), **options
    )
    got = run(numba, way, strain)
    slips = np.flatnonzero((truth["slip"] > 0) & (got["grows"] > 0))[1:]
    assert len(slips) >= 6
    true = (truth["x"] * direction[0] + truth["y"] * direction[1]) / PITCH
    ratio = np.polyfit(true[slips], got["along"][slips], 1)[0]
    assert 0.87 <= ratio <= 1.58
    # a stop is three times as likely at first: within these frames that must be made up for
    gain = got["against_stops"][slips[:6]] / got["over"][slips[:6]]
    assert gain.max() > 5.0


def test_what_has_stopped_stays(numba, run, simulate):
    """Its way scatters by its noise, and those that are over lose by it."""
    script = (*HELD, Phase("pull", 0.04, speed=0.8e-3, direction=0.7), Phase("hold", 0.1))
    strain, truth = simulate(script=script, seed=52, rate=200.0)
    assert not truth["slip"].any()
    got = run(numba, way, strain)
    pulled = np.flatnonzero(np.hypot(truth["shear_x"], truth["shear_y"]) > 0)
    still = np.array([n for n in pulled[8:] if got["grows"][n] > 0])
    assert len(still) >= 5
    sd = np.sqrt(got["noise"][still].mean())
    # of as many frames five standard deviations are once in a million
    assert abs(got["along"][still] - got["along"][still].mean()).max() < 5.0 * sd
    assert got["against_stops"][still[4:]].max() < 2.0 * got["over"][still[4:]].max()


@pytest.mark.parametrize("array", [{}, {"reads": "strain", "depth": 2e-3 / PITCH}])
def test_a_pull_that_slides_within_a_frame(fast, run, simulate, array):
    """It has no bend: that the contact moves on at once, and stays at it, is all there is.

    A weight under which an object begins to roll looks like that, too, so that one in ten is left.
    """
    script = (
        Phase("hold", 0.5),
        Phase("press", 0.3, load=0.28),
        Phase("hold", 0.3),
        Phase("pull", 0.25, speed=2.8e-3, direction=0.7),
        Phase("relax", 0.1),
    )
    options = {"rate": 60.0, "thickness": 2e-3, "radius": 24e-3, "friction": 0.35}
    found = 0
    for seed in range(80, 92):
        strain, truth = simulate(script=script, seed=seed, start=(0.1e-3, -0.2e-3), **options)
        got = run(fast, slip.bind(**array), strain, ["gross_slip"])
        gone = np.flatnonzero(got["gross_slip"] > 0)
        found += bool(gone.size) and abs(int(gone[0]) - int(np.argmax(truth["slip"]))) <= 5
    assert found >= 11


def test_engines_agree(fast, run, simulate):
    """Differences of sums that nearly cancel: float32 keeps four digits of the way."""
    script = (*HELD, Phase("pull", 0.2, speed=1.2e-3, direction=0.7))
    strain, _ = simulate(script=script, seed=53, rate=100.0, shape=(4, 4))
    got, exact = (run(engine, way, strain, ["along"]) for engine in (fast, Engine("reference")))
    assert abs(got["along"] - exact["along"])[30:].max() <= 1e-4 * abs(exact["along"]).max()
