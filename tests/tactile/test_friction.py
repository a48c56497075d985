"""The friction that a force would need, against the simulation's, and what it is for."""

import numpy as np
import pytest

from cnnum.drivers.simulated.script import Phase
from cnnum.errors import UnknownNameError
from cnnum.programs import program
from cnnum.templates.tactile.contact_mechanics.contact_wrench import force_on, place_of
from cnnum.templates.tactile.contact_mechanics.cover_response import Skin, as_read, felt_by
from cnnum.templates.tactile.contact_mechanics.growth_laws import pull_law
from cnnum.templates.tactile.contact_mechanics.traction_lag import looked_at
from cnnum.templates.tactile.shared.friction import friction_needed
from cnnum.templates.tactile.shared.loads import PUSH, loads_of, patch_of
from cnnum.templates.tactile.slip import slip

HELD = (Phase("hold", 0.3), Phase("press", 0.3, load=0.6), Phase("hold", 0.3))
PITCH = 1.5e-3


@program
def needed(frame, *, depth: float = 0.5, cover: str = "flat"):
    """What `slip` asks of a force."""
    contact = place_of(loads := loads_of(frame, PUSH), patch_of(loads))
    force = force_on(contact, lambda _: pull_law())
    force.close(force.growth.grows)
    return {
        "friction": friction_needed(contact, force, Skin(depth, "strain", cover, 0.4)),
        "grows": force.growth.grows,
    }


@pytest.mark.parametrize("cover", ["flat", "bumpy", "bumps-fem"])
@pytest.mark.parametrize("thickness", [0.7e-3, 2.0e-3])
def test_what_slides_needs_its_friction(numba, run, simulate, cover, thickness):
    """Of it taxels read 6 to 7 times as much under 0.7 mm of a flat cover, 2.0 to 2.3 on bumps,
    and 1.8 to 2.1 under 2 mm. Where the contact stands between taxels makes up to 20 %.
    """
    script = (*HELD, Phase("pull", 0.6, speed=1.2e-3, direction=0.7))
    options = {"cover": cover, "thickness": thickness, "friction": 0.45, "seed": 61}
    strain, truth = simulate(script=script, rate=100.0, start=(-0.3e-3, 0.1e-3), **options)
    got = run(numba, needed.bind(depth=thickness / PITCH, cover=cover), strain)
    slides = (truth["slip"] > 0) & (got["grows"] > 0)
    assert slides.sum() >= 5
    assert got["friction"][slides][:5] == pytest.approx(0.45, rel=0.2)


@pytest.mark.parametrize("shape", [(4, 4), (8, 8), (5, 12)])
def test_taxels_at_the_surface_read_the_traction_itself(shape):
    """Stress there is traction, and what slides with a friction of 1 pulls as it presses."""
    # 0.01 pitches down a cell of 0.25 has lost 2 % to its sides, shear and pressure alike
    gain = as_read(shape, Skin(0.01, "stress", "flat", 0.4)).gain
    assert gain == pytest.approx(np.ones(5), abs=0.02)


def test_taxels_that_carry_their_own_load_read_it_whichever_way_it_acts():
    skin = Skin(0.5, "force", "bumpy", 0.4)
    assert as_read((8, 8), skin).gain == pytest.approx(np.ones(5), rel=1e-12)
    # and lag behind nothing
    assert looked_at(felt_by((8, 8), skin), 1.5, 3.5, 3.4).lag == pytest.approx(0.0, abs=1e-12)


def test_an_object_that_rolls_along_its_weight_does_not_slip(fast, run, simulate):
    """Its contact moves on along the force, as fast as in slip; but rubber has more friction.

    The weight is 0.17 of the normal load, and comes within two frames: it has hardly a bend.
    """
    script = (
        *HELD,
        Phase("pull", 2 / 60, speed=1.08e-3, direction=0.7),
        Phase("roll", 0.4, speed=1.57e-3, direction=0.7),
    )
    options = {"thickness": 1e-3, "radius": 22.6e-3, "friction": 1.0, "rate": 60.0}
    for seed in range(62, 68):
        strain, truth = simulate(script=script, seed=seed, start=(-0.2e-3, 0.1e-3), **options)
        assert not truth["slip"].any()
        got = run(fast, slip.bind(reads="strain", depth=1e-3 / PITCH), strain, ["gross_slip"])
        assert not got["gross_slip"].any()


@pytest.mark.parametrize(("cover", "reads"), [("wavy", "strain"), ("flat", "volts")])
def test_unknown_skins_are_refused(cover, reads):
    with pytest.raises(UnknownNameError, match=r"wavy|volts"):
        Skin(0.5, reads, cover, 0.4)
