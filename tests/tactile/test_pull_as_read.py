"""What taxels read of a pull, against the simulation's own force; slip at 1000 frames a second."""

import numpy as np
import pytest

from cnnum.drivers.simulated.script import Phase
from cnnum.programs import program
from cnnum.templates.tactile.contact_mechanics.contact_wrench import force_on, place_of
from cnnum.templates.tactile.contact_mechanics.cover_response import Skin, felt_by
from cnnum.templates.tactile.contact_mechanics.growth_laws import NEARER, pull_law
from cnnum.templates.tactile.contact_mechanics.traction_lag import AtRest, lag_of, looked_at
from cnnum.templates.tactile.shared.loads import PUSH, loads_of, patch_of
from cnnum.templates.tactile.slip import slip

HELD = (Phase("hold", 0.2), Phase("press", 0.2, load=0.8), Phase("hold", 0.2))
COVERS = [
    {},
    {"thickness": 2.0e-3},
    {"shape": (4, 4)},
    {"cover": "bumpy", "shape": (4, 4)},
    {"cover": "bumps-fem", "thickness": 1.4e-3},
]
NAMES = ["flat", "thick", "4x4", "bumpy", "bumps-fem"]


PITCH = 1.5e-3


@program
def read(frame, *, skin):
    """The force as the taxels near the contact read it, and by how much it should lag."""
    loads = loads_of(frame, PUSH)
    contact = place_of(loads, patch_of(loads))
    rest = AtRest(contact)
    force = force_on(contact, lambda _: pull_law())
    x, y = force.growth.load
    grows = force.growth.grows
    lag = lag_of(contact, rest, skin, force.growth.load)
    rest.learn(force.close(grows & ~grows))
    return {"x": x, "y": y, "grows": grows, "lag": lag}


@pytest.mark.parametrize("dead", [(), (-1, 0)], ids=["whole", "dead"])
@pytest.mark.parametrize("options", COVERS, ids=NAMES)
def test_what_is_read_lags_behind_the_force(fast, run, simulate, options, dead):
    """By as much of s^(3/2) (1 − s), s = 1 − t/T, as the half-space under the cover says."""
    script = (*HELD, Phase("pull", 0.4, speed=1.2e-3, direction=0.7))
    scene = {"rate": 500.0, "friction": 0.6, "noise": 1e-4, "bits": 0, "seed": 81}
    strain, truth = simulate(script=script, **scene, **options)
    if dead:
        row, column = (
            size // 2 + place for size, place in zip(strain.shape[1:3], dead, strict=True)
        )
        strain[:, row, column] = 0.0
    depth = options.get("thickness", 0.7e-3) / PITCH
    skin = Skin(depth, "strain", options.get("cover", "flat"), 0.4)
    got = run(fast, read.bind(skin=skin), strain)
    slips = int(np.argmax(truth["slip"] > 0))
    pulled = np.hypot(truth["shear_x"], truth["shear_y"])
    begins = int(np.flatnonzero(pulled[:slips] == 0.0)[-1])
    times = np.arange(begins, slips + 1)
    assert np.all(got["grows"][times[10:]] > 0)
    left = 1.0 - (times - begins) / (slips - begins)
    force = got["x"][times] * np.cos(0.7) + got["y"][times] * np.sin(0.7)
    mindlin = 1.0 - left**1.5
    # the simulation's own force is Mindlin's: both ends are told to a frame of about a hundred
    np.testing.assert_allclose(pulled[times] / pulled[slips], mindlin, atol=0.02)
    bulge = left**1.5 * (1.0 - left)
    offset = np.ones_like(left)
    # where a taxel is dead the pull is noticed some frames late, and what it was then is taken off
    seen = times - begins >= 10
    mindlin, bulge, offset, force = (part[seen] for part in (mindlin, bulge, offset, force))
    (whole, lag, _), *_ = np.linalg.lstsq(np.stack([mindlin, bulge, offset], 1), force)
    told = got["lag"][slips]
    # 0.012 RMS over 63 pulls, twice that; what a dead taxel of 16 would read under bumps, 0.03 RMS
    on_bumps = dead and "cover" in options
    assert -lag / whole == pytest.approx(told, abs=0.05 if on_bumps else 0.024)

    def rest(share):
        law = np.stack([mindlin - share * bulge, offset], 1)
        return np.linalg.lstsq(law, force)[1][0]

    assert dead or rest(told) < rest(0.0)


@pytest.mark.parametrize("options", [{}, {"cover": "bumps-fem"}], ids=["flat", "bumps-fem"])
def test_slip_is_told_within_five_frames_of_a_millisecond(fast, run, simulate, options):
    """A pull of a tenth of a second to slip; without the lag it was told 4 to 9 frames late."""
    script = (*HELD, Phase("pull", 0.4, speed=0.6e-3, direction=0.7))
    strain, truth = simulate(script=script, rate=1000.0, friction=0.6, seed=82, **options)
    got = run(fast, slip, strain, ["gross_slip"])
    slips = int(np.argmax(truth["slip"] > 0))
    told = int(np.argmax(got["gross_slip"] > 0))
    assert truth["slip"][slips]
    assert got["gross_slip"][told]
    assert abs(told - slips) <= 5


@pytest.mark.parametrize("place", [(1.5, 1.5), (1.7, 1.25)])
@pytest.mark.parametrize("radius", [1.0, 1.5])
def test_far_below_the_lag_is_a_closed_form(radius, place):
    """There a taxel reads shear stress as 3 x² / (2π z⁴) along the pull, and 3 xy / (2π z⁴) aside,
    x and y away (Cerruti).

    Over a disc of radius c that makes x² + c²/5 and xy (Hertz). So what is missing of a taxel is
    s^(3/2) (x² + a²/5 − (1 − s) a²/5), exactly, and aside nothing lags.
    """
    felt = felt_by((4, 4), Skin(40.0, "stress", "flat", 0.4), 8)
    row, column = place
    looked = looked_at(felt, radius, row, column)
    assert looked.seen.felt.all()
    disc, x = radius**2 / 5.0, np.indices((4, 4))[1].ravel() - column
    whole = x**2 + disc
    # cells of an eighth of a pitch, and a depth of 40: (2.5/40)² 5 of the next power is left
    np.testing.assert_allclose(looked.whole, whole / whole.sum(), rtol=0.03)
    np.testing.assert_allclose(looked.bulge, disc / whole.sum(), rtol=0.03)
    assert looked.lag == pytest.approx(-16 * disc / whole.sum(), rel=0.03)
    assert looked.turned == pytest.approx(0.0, abs=0.002)


def test_who_knows_no_cover_takes_the_usual_lag(fast, run, simulate):
    strain, _ = simulate(script=HELD, rate=60.0, seed=83)
    got = run(fast, read.bind(skin=Skin(0.5, "force", "flat", 0.4)), strain, ["lag"])
    assert got["lag"] == pytest.approx(np.full(len(strain), NEARER))
