"""Loads, place and area through a cover, against Hertz, Cattaneo–Mindlin and their integrals."""

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.signal import correlate2d

from cnnum.drivers.simulated.cover import Layout, flat_influence
from cnnum.drivers.simulated.settings import Phase
from cnnum.errors import UnknownNameError
from cnnum.lab.bench.programs.contact_errors import aliased, errors, run_contact
from cnnum.tactile.bump_loads import DECONVOLUTION_LEFT, left_kernel, unblur_kernel
from cnnum.tactile.halfspace import SurfaceToDepth, strain_transfer
from cnnum.tactile.indenters import Disc, Rectangle, Touch, drawn, frame_under, readings
from cnnum.templates.tactile.contact import contact
from cnnum.templates.tactile.shared.pressure import NEAR, pulled_far, pulled_normal, shear_seen

MODULUS, PITCH, THICKNESS = 0.87e6, 1.5e-3, 1e-3
"""Of the simulated array: its script presses up to 1.6 N."""

TOUCH = (
    Phase("hold", 0.15),
    Phase("press", 0.2, load=0.8),
    Phase("pull", 0.5, speed=1.2e-3, direction=0.7),
    Phase("twist", 0.2, angle=0.2),
    Phase("release", 0.2),
)


def cover(cells, depth, reads):
    return SurfaceToDepth(
        (cells, cells), 1.0, depth, youngs_modulus=1.5 if reads == "strain" else None
    )


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("cells", "depth", "reads"),
    [(8, 0.5, "strain"), (8, 1.3, "strain"), (8, 1.0, "stress"), (16, 1.0, "strain")],
)
def test_loads_of_pulled_spheres(fast, cells, depth, reads):
    """Radii from 1.5 cells to 0.4 of the array, half of them slipping at the rim."""
    touches = drawn(np.random.default_rng(7), (1.5, 4.0), cells, 16)
    got = run_contact(fast, touches, cells, depth, reads)
    off = errors(touches, got, cells)
    # the filter gives pressure back to a few per cent. The rim of the contact is cut cell by
    # cell: 8 % at most in 1000 touches of docs/programs/contact.md
    assert np.abs(off["load_normal"]).max() < 0.1
    # noise of 64 or 256 summed taxels, and the spread of the shear where half of the array does
    # not see it; the weakest pulls are a tenth of the load
    assert np.quantile(off["load_x, load_y"], 0.9) < 0.1
    assert np.median(off["load_x, load_y"]) < 0.05
    assert np.quantile(np.abs(off["friction_used"]), 0.9) < 0.12
    # strain cannot set pull and pressure apart wholly: a tenth of the radius
    assert off["place"].max() < 0.4
    # whole taxels: the rim crosses 10 to 25 of them
    assert np.abs(off["contact_area"]).max() < 0.45
    assert np.abs(np.median(off["contact_area"])) < 0.2


@pytest.mark.parametrize("reads", ["strain", "stress"])
def test_narrow_contacts_weigh_what_their_readings_allow(fast, reads):
    """Half a cell to one in radius: between taxels, their sum is all that is known."""
    for depth, limit in ((0.75, 0.15), (1.0, 0.15)):
        touches = drawn(np.random.default_rng(12), (0.5, 1.0), 8, 24)
        off = errors(touches, run_contact(fast, touches, 8, depth, reads), 8)["load_normal"]
        assert aliased(0.5, depth, reads) < 0.1
        # that, and twice the 5 % by which a sphere's shape is not that of loads on whole cells
        assert np.quantile(np.abs(off), 0.9) < limit


@pytest.mark.parametrize(("radius", "depth"), [(0.5, 0.5), (0.7, 0.5), (0.5, 1.0)])
def test_readings_add_up_by_place(radius, depth):
    """Stress adds up to the load, on and between taxels, but for waves of the pitch."""
    axis = np.arange(-60.0, 61.0)
    x, y = np.meshgrid(axis, axis)
    sums = []
    for at in (0.0, 0.5):
        body = Disc(radius, (at, at), "hertz")
        sums.append(body.normal(x, y, depth, "stress").sum() / (np.pi * radius**2))
    # an array of 121 pitches misses (z/60)³ of stress that falls off as the fifth power
    wanted = aliased(radius, depth, "stress")
    assert max(abs(each - 1.0) for each in sums) == pytest.approx(wanted, abs=2e-3)


def test_a_pull_does_not_move_the_contact(fast):
    """The normal strain alone is off by more than two cells; it must not be believed."""
    still, pulled = (Touch(5.0, (0.0, 0.0), pull, 0.0, 0.7) for pull in (0.0, 0.65))
    seen = -readings(pulled, 16, 0.5, "strain")[..., 2]
    raw = np.where(seen > 0.1 * seen.max(), seen, 0.0)
    assert np.abs((raw * np.arange(16)).sum() / raw.sum() - 7.5) > 2.0
    got = run_contact(fast, [still, pulled], 16, 0.5, "strain")
    # a seventh of the radius is left of it, and a quarter more load
    assert got["contact_column"] == pytest.approx(7.5, abs=0.7)
    assert got["load_normal"] == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize("shape", [(4, 4), (8, 8)])
def test_newtons_of_a_simulated_hand(fast, run, simulate, shape):
    """A sphere that presses, slips, twists and lets go, with offsets, noise and a converter."""
    strain, truth = simulate(shape=shape, script=TOUCH, start=(-0.4e-3, -0.3e-3), seed=3)
    program = contact.bind(depth=THICKNESS / PITCH, unit=2 / 3 * MODULUS * PITCH**2)
    got = run(fast, program, strain)
    on = truth["normal_force"] > 0.25 * truth["normal_force"].max()
    load = truth["normal_force"][on]
    # contacts of 1 to 1.6 cells in radius: a cell more or less at the rim
    assert np.quantile(np.abs(got["load_normal"][on] / load - 1.0), 0.95) < 0.1
    for name, true in (("load_x", "shear_x"), ("load_y", "shear_y")):
        # on 4×4 taxels a third of the shear lies beyond the array, and is inferred
        assert np.abs(got[name] - truth[true])[on].max() < (0.08 if shape == (4, 4) else 0.06)
    used = np.hypot(truth["shear_x"], truth["shear_y"])[on] / load
    assert used.max() == pytest.approx(0.6, abs=1e-3)
    assert np.quantile(np.abs(got["friction_used"][on] - used), 0.95) < 0.06


@pytest.mark.parametrize("reads", ["strain", "stress"])
def test_other_bodies_weigh_what_they_carry(fast, run, reads):
    """Their mean pressure is 1, so that the load is the area."""
    bodies = [Disc(2.5), Disc(2.5, pressure="punch"), Rectangle(3.0, 4.0, 0.4)]
    seen = np.stack([frame_under(body, (8, 8), 0.5, reads) for body in bodies])
    frames = 2.5e-3 * np.random.default_rng(0).normal(size=(23, 3, 8, 8, 3))
    frames[20:, ..., 2] -= seen
    got = run(fast, contact.bind(reads=reads), frames)
    area = np.array([np.pi * 2.5**2, np.pi * 2.5**2, 12.0])
    # as of spheres
    assert got["load_normal"][-1] == pytest.approx(area, rel=0.1)
    # a cell is touched where it is covered by a tenth, half of which is too much around the rim
    assert (area * 0.95 <= got["contact_area"][-1]).all()
    assert (got["contact_area"][-1] <= area * 1.6).all()


def test_stray_readings_are_refused():
    with pytest.raises(UnknownNameError, match="'strain', 'stress', 'force'"):
        contact.bind(reads="volt").trace((8, 8))


def test_normal_strain_shows_nothing_that_the_shear_does_not():
    """Wave by wave ε_zz = i (kx ε_xz + ky ε_yz)/k, or its opposite, for pulls and pushes alike.

    So no filter parts them, and `contact` has to know where the pull acts.
    """
    kx, ky = np.random.default_rng(3).uniform(-3.0, 3.0, (2, 50))
    passes = strain_transfer(kx, ky, 0.7, youngs_modulus=1.5)
    along = 1j * (kx[:, None] * passes[:, 0] + ky[:, None] * passes[:, 1])
    along /= np.hypot(kx, ky)[:, None]
    sign = np.sign((along[0, 2] / passes[0, 2, 2]).real)
    np.testing.assert_allclose(sign * along, passes[:, 2], atol=1e-12)


@pytest.mark.parametrize("reads", ["strain", "stress"])
def test_pulled_normal_is_cerruti_summed(reads):
    """By hand: kernels near and far against every cell's own influence on an array of 16×16."""
    rng, depth = np.random.default_rng(1), 0.6
    load = np.zeros((16, 16, 3))
    load[3:12, 4:13, :2] = rng.uniform(0.5, 1.0, (9, 9, 2))
    true = -cover(16, depth, reads)(load)[..., 2]
    block = np.ones((3, 3))
    near, far = pulled_normal(depth, reads, NEAR), pulled_far(depth, reads, 15)
    found = sum(
        correlate2d(load[..., axis], near[axis], mode="same")
        + correlate2d(correlate2d(load[..., axis], block, mode="same"), far[axis], mode="same")
        for axis in (0, 1)
    )
    # pulls more than 7 cells away are even on blocks of 9. At the rim of the array those are lost
    # whose block has its middle beyond it
    assert np.abs(found - true).max() < 0.02 * np.abs(true).max()
    exact = correlate2d(load[4:12, 5:13, 0], near[0], mode="same")
    part = np.zeros_like(load)
    part[4:12, 5:13, 0] = load[4:12, 5:13, 0]
    np.testing.assert_allclose(exact, -cover(16, depth, reads)(part)[4:12, 5:13, 2], atol=1e-12)


def test_shear_seen_is_what_the_array_adds_up_to():
    depth = 0.7
    seen = shear_seen((5, 7), depth)
    for row, col in ((0, 0), (2, 3), (4, 1)):
        for axis, (own, pushed) in enumerate(
            ((seen.own_x, seen.pushed_x), (seen.own_y, seen.pushed_y))
        ):
            for kind, found in ((axis, own), (2, pushed)):
                load = np.zeros((5, 7, 3))
                load[row, col, kind] = 1.0
                read = SurfaceToDepth((5, 7), 1.0, depth, youngs_modulus=1.5)(load)
                assert found[row, col] == pytest.approx(-read[..., axis].sum(), abs=1e-12)
    # the share that an array misses falls as depth over side: twice 0.5/61 around, and the corners
    wide = shear_seen((61, 61), 0.5)
    assert wide.own_x[30, 30] == pytest.approx(1.0, abs=0.03)
    assert wide.pushed_x[30, 30] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("reads", ["strain", "stress"])
def test_left_kernel_is_what_the_filter_leaves(reads):
    """A load on one cell less the filter's result of it, on an array that holds both."""
    side = 2 * (DECONVOLUTION_LEFT + 4) + 1
    load = np.zeros((side, side, 3))
    load[side // 2, side // 2, 2] = 1.0
    back = correlate2d(
        -cover(side, 0.8, reads)(load)[..., 2], unblur_kernel(0.8, reads), mode="same"
    )
    middle = slice(4, side - 4)
    np.testing.assert_allclose(
        left_kernel(0.8, reads), (load[..., 2] - back)[middle, middle], atol=1e-12
    )


@pytest.mark.parametrize(("thickness", "least", "most"), [(0.5e-3, 0.65, 1.25), (1e-3, 0.9, 1.17)])
def test_readings_under_a_thin_cover_leave_the_load_open(thickness, least, most):
    """A linear program: the least and largest load of pressures that read as a sphere of 1 N does.

    They press, nowhere pull, within half a pitch around its contact, and read alike to 0.5 % of the
    peak. Without the shape of the body no program can know more.
    """
    layout = Layout((8, 8), PITCH)
    place = np.hypot(*np.meshgrid(layout.surface.x, layout.surface.y))
    radius = (0.75 * 25e-3 * (1.0 - 0.25) / MODULUS) ** (1 / 3)
    true = np.sqrt(np.maximum(0.0, 1.0 - (place / radius) ** 2))
    near = place < radius + PITCH / 2
    response = flat_influence(layout, thickness, MODULUS)[..., 2, 2][:, :, near].reshape(64, -1)
    read = response @ true[near]
    scale, off = np.abs(response).max(), 0.005 * np.abs(read).max()
    bounds = [
        linprog(
            sign * np.ones(near.sum()),
            A_ub=np.vstack([response, -response]) / scale,
            b_ub=np.concatenate([read + off, off - read]) / scale,
        ).x.sum()
        / true.sum()
        for sign in (1, -1)
    ]
    if thickness < PITCH / 2:  # docs/programs/contact.md
        assert bounds[0] < least
        assert bounds[1] > most
    else:
        assert least < bounds[0] < 1.0 < bounds[1] < most
