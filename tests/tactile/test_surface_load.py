"""Surface load from a frame: the network against dense least squares, and several contacts."""

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.errors import ProgramError
from cnnum.lab.bench.programs import load_errors
from cnnum.lab.bench.programs.halfspace_runs import inverse
from cnnum.tactile.halfspace import SurfaceToDepth
from cnnum.tactile.inverse import LoadMap
from cnnum.templates.tactile.surface_load import LoadNetwork, surface_load
from docs.figures.halfspace_figures import contacts

PITCH, THICKNESS, E, NOISE, LIKELY = 1.5e-3, 1.0e-3, 0.87e6, 1e-4, 3e3
HEIGHTS = {6e3: 5.9e3, 8e3: 7.9e3, 12e3: 11.9e3}
NAMES = ("load_x", "load_y", "load_normal")


def taxels(shape):
    rows, cols = ((np.arange(n) - (n - 1) / 2) * PITCH for n in shape)
    y, x = np.meshgrid(rows, cols, indexing="ij")
    return np.stack([x.ravel(), y.ravel()], axis=-1)


LINEAR = {"rounds": 0, "drag": 1.0}
"""Least squares of loads and noise without correlation, with no more known of the loads."""


def least_squares(shape, beyond=7, noise=NOISE):
    """Singular values of loads on the array and cells around it, and where the array is."""
    rows, cols = shape
    cover = LoadMap(
        taxels(shape), (rows + 2 * beyond, cols + 2 * beyond), PITCH, THICKNESS, E, noise
    )
    return cover, np.s_[..., beyond : beyond + rows, beyond : beyond + cols, :]


def answer(engine, strain, **options):
    shape = strain.shape[-3:-1]
    program = surface_load.bind(noise=NOISE, likely=LIKELY, **options)
    got = engine.compile(program, shape)(strain)
    return np.stack([got[name] for name in NAMES], axis=-1), got["residual"]


@pytest.mark.parametrize("shape", [(4, 4), (5, 6)])
def test_the_network_is_least_squares(fast, shape):
    strain = np.random.default_rng(2).normal(0.0, 3e-3, (2, *shape, 3))
    got, _ = answer(fast, strain, **LINEAR)
    cover, on_array = least_squares(shape)
    wanted = cover(strain.reshape(2, -1, 3), LIKELY).traction[on_array]
    # singular values feel loads on cells that are more than 7 away, too; without them see `dense`
    assert np.abs(got - wanted).max() <= 2e-2 * np.abs(wanted).max()


def test_drags_are_as_likely_as_said(fast):
    """By hand: with drags ten times less likely, strain comes from pressure."""
    load, _ = two_contacts()
    load[..., :2] = 0.0
    cover = SurfaceToDepth((8, 8), PITCH, THICKNESS, youngs_modulus=E)
    found = {d: answer(fast, cover(load), rounds=0, drag=d)[0] for d in (1.0, 0.1)}
    pressed = load[..., 2] > 0
    kept = {d: each[pressed, 2].mean() / load[pressed, 2].mean() for d, each in found.items()}
    pulled = {d: np.abs(each[..., :2]).max() for d, each in found.items()}
    assert kept[0.1] > kept[1.0] + 0.1
    assert pulled[0.1] < 0.5 * pulled[1.0]


def two_contacts():
    """Two patches pressed and dragged apart, their strain from Love and Cerruti."""
    load = np.zeros((8, 8, 3))
    load[1:3, 1:3] = [1e3, 0.0, 8e3]
    load[5:7, 4:7] = [0.0, -2e3, 6e3]
    cover = SurfaceToDepth((8, 8), PITCH, THICKNESS, youngs_modulus=E)
    return load, cover(load)


@pytest.mark.parametrize("rounds", [0, 1, 3])
def test_several_contacts_come_back_at_once(fast, rounds):
    load, strain = two_contacts()
    noisy = strain + np.random.default_rng(3).normal(0.0, NOISE, strain.shape)
    got, residual = answer(fast, noisy, rounds=rounds)
    inside = load[..., 2] > 0
    pressure = got[..., 2]
    # without rounds, the load between contacts is the ground that they stand on
    ground = np.median(pressure[~inside]) if rounds == 0 else 0.0
    touched = pressure - ground > 3e3
    assert (touched == inside).all()
    for patch, wanted in ((np.s_[1:3, 1:3], 8e3), (np.s_[5:7, 4:7], 6e3)):
        # a resolution of about a taxel smears an eighth of a patch of two over its edge
        assert abs(pressure[patch].mean() - ground - wanted) <= 0.2 * wanted
    # a fit takes up some noise; loads that nowhere pull leave strain that least squares would take
    assert 0.1 <= residual <= (1.2 if rounds == 0 else 6.0)
    if rounds:
        assert pressure.min() >= 0.0
        assert not got[..., :2][pressure == 0.0].any()


def test_no_drag_exceeds_friction(fast):
    load, strain = two_contacts()
    free, _ = answer(fast, strain)  # as in other tests, whose kernel is there
    held, _ = answer(fast, strain, friction=0.2)
    for found, friction in ((free, 1.0), (held, 0.2)):
        drag = np.hypot(found[..., 0], found[..., 1])
        # float32: the bound is divided by the drag, which it then scales
        assert (drag <= friction * found[..., 2] * (1 + 1e-6)).all()
    pressed = load[..., 2] > 0
    assert np.abs(free[pressed] - held[pressed])[:, :2].max() > 100.0


def test_rounding_decides_about_no_load(fast):
    """Strains of order 1, ten thousand times the noise: the worst frames for cells that switch."""
    frames = np.random.default_rng(0).normal(size=(1024, 8, 8, 3))
    fused = fast.compile(surface_load.bind(), (8, 8))(frames)
    # on the host: the kernel of all steps takes OpenCL's compiler longer than all else here
    host = Engine("numba", precision=fast.precision)
    stepped = host.compile(surface_load.bind(), (8, 8)).unfused()(frames)
    for name in NAMES:
        # the bench finds 1.1e-4 in a thousand frames: float32 times the gain of the inverse
        assert np.abs(fused[name] - stepped[name]).max() <= 5e-4 * np.abs(stepped[name]).max()


def test_noise_and_resolution_are_those_stated(fast):
    rng = np.random.default_rng(4)
    got, _ = answer(fast, rng.normal(0.0, NOISE, (400, 8, 8, 3)), **LINEAR)
    cover, on_array = least_squares((8, 8), beyond=4)
    stated = np.reshape(cover.noise_error(LIKELY), (16, 16, 3))[on_array] / 1.959964
    # 400 frames know a standard deviation to 1/√800 = 3.5 %; the worst of 192 is within four
    assert np.abs(got.std(axis=0) / stated - 1).max() <= 0.16


def test_the_noise_of_an_endless_array_is_that_of_the_middle_of_a_large_one(fast):
    """From which on a drag is believed."""
    network = LoadNetwork(THICKNESS, PITCH, E, 1e-3, LIKELY, 0.3, 5)
    noise = np.random.default_rng(5).normal(0.0, 1e-3, (300, 14, 14, 3))
    options = {"noise": 1e-3, "reach": 5, "rounds": 0}
    plan = fast.compile(surface_load.bind(**options), (14, 14), ["load_normal"])
    middle = plan(noise)["load_normal"][:, 6:8, 6:8]
    # 1200 numbers know it to 2 %, three of which; cells nearer to the rim are known less
    assert middle.std() == pytest.approx(network.noise_of_pressure, rel=0.08)


def test_heights_are_true(fast):
    """The contacts of docs/programs/halfspace.md, and the figures given there."""
    (_, true, _), _, (_, found, _) = contacts(fast)
    assert found.min() == 0.0
    for pressure, height in HEIGHTS.items():
        # as printed there, to its last digit
        assert found[true == pressure].mean() == pytest.approx(height, abs=50.0)
        assert height == pytest.approx(pressure, rel=0.2)


@pytest.mark.parametrize("thickness", [0.5e-3, 1.0e-3, 1.5e-3])
def test_noise_dips_where_the_singular_values_say(fast, thickness):
    kept = inverse(fast, PITCH, thickness)
    cover = LoadMap(taxels((8, 8)), (16, 16), PITCH, thickness, E, NOISE)
    stated = np.reshape(cover.noise_error(LIKELY), (16, 16, 3))[8, 8, 2] / 1.959964
    # 200 frames know a standard deviation to 5 %: within two of these
    assert kept["noise"] == pytest.approx(stated, rel=0.1)


def test_a_larger_array_takes_no_steps(fast):
    """Of 16×16 taxels with a reach of 7: K Pᵀ Kᵀ on the taxels alone is small enough for a product.

    Held to singular values whose loads lie up to 7 cells beyond the rim.
    """
    shape, noise = (16, 16), 1e-3
    plan = fast.compile(surface_load.bind(noise=noise, **LINEAR), shape, list(NAMES))
    assert not any("steps" in how for how in plan.explain().transients)
    strain = np.random.default_rng(5).normal(0.0, 3e-3, (*shape, 3))
    got = plan(strain)
    network = LoadNetwork(THICKNESS, PITCH, E, noise, LIKELY, 1.0, 7)
    felt = dense(network, shape)
    loads = felt.T @ np.linalg.solve(felt @ felt.T + np.eye(len(felt)), strain.ravel() / noise)
    wanted = LIKELY * loads.reshape(30, 30, 3)[7:-7, 7:-7]
    for n, name in enumerate(NAMES):
        # float32: 768 roundings of 6e-8 times the sum of the gain
        assert np.abs(got[name] - wanted[..., n]).max() <= 1e-4 * np.abs(wanted).max()


def dense(network, shape):
    """Strain over noise by load over the likely one, cell by cell, from Love's and Cerruti's."""
    reach, (rows, cols) = network.reach, shape
    weights = network.influence() * LIKELY / network.noise
    felt = np.zeros((rows, cols, 3, rows + 2 * reach, cols + 2 * reach, 3))
    for r in range(rows):
        for c in range(cols):
            at = np.s_[r : r + 2 * reach + 1, c : c + 2 * reach + 1]
            felt[r, c][:, *at] = np.moveaxis(weights, 1, -1)
    return felt.reshape(3 * rows * cols, -1)


def test_one_round_halves_the_error(fast):
    """Contacts anywhere on 16×16 taxels; see `python -m cnnum.lab.bench.programs.load_errors`."""
    none, one = (
        load_errors.measure(fast, 1e-4, rounds, count=40, timed=False) for rounds in (0, 1)
    )
    assert one.rms < 0.5 * none.rms
    assert abs(one.height - 1.0) < abs(none.height - 1.0)
    # 0.9 of all pressure is found, and edges lose a tenth of it
    assert one.height > 0.9


def test_long_waves_are_shared_between_a_pressure_and_a_pull():
    """Where no noise is, by hand: kz e^(−kz) and (1 − kz) e^(−kz) of the same two strains."""
    waves = np.array([3e-3, 6e-3, 12e-3, 48e-3])
    kz = 2 * np.pi * THICKNESS / waves
    for drag in (1.0, 0.3):
        wanted = kz**2 / (kz**2 + (drag * (1 - kz)) ** 2)
        assert load_errors.kept(1e-9, drag, waves) == pytest.approx(wanted, rel=1e-4)
    # and noise only takes away
    assert (load_errors.kept(1e-3, 0.3, waves) < load_errors.kept(1e-9, 0.3, waves)).all()


def test_wrong_covers_are_refused():
    for name, value in (("noise", 0.0), ("rounds", -1), ("friction", 0.0), ("reach", 0)):
        with pytest.raises(ProgramError, match=f"'{name}': expected .* got {value:g}"):
            surface_load.bind(**{name: value}).trace((8, 8))
