"""Ends that are found without the way there are those that the array comes to.

Monotone templates of every kind are drawn, with every boundary, masks and bias maps, and integrated
by SciPy from an equation that is written here. A long run (`make fuzz`) draws more.
"""

import os
import time

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.ndimage import binary_fill_holes, binary_propagation

import cnnum
from cnnum.engines.numba.wavefront import drive_of
from cnnum.errors import MethodError

SECONDS = float(os.environ.get("CNNUM_FUZZ", "0"))
LATER = (0.0, 5.0, 30.0)
"""Time constants after which states are compared, from the time on that is named as the end's."""
NUMERIC = 1e-6
"""Of SciPy's integration, in relative tolerances of 1e-8."""
FLOATS = (np.float32, np.float64)


def around(boundary, array, reach):
    if isinstance(boundary, float):
        return np.pad(array, reach, constant_values=boundary)
    return np.pad(array, reach, "symmetric" if boundary == "zero-flux" else "wrap")


def correlated(kernel, array, boundary):
    reach, (rows, cols) = kernel.shape[0] // 2, array.shape
    wide, total = around(boundary, array, reach), np.zeros(array.shape)
    for (i, j), weight in np.ndenumerate(kernel):
        total += weight * wide[i : i + rows, j : j + cols]
    return total


def drawn(seed):
    """Return a template whose weights to others are not negative, and the maps of a run."""
    rng = np.random.default_rng(seed)
    reach = int(rng.choice([1, 1, 1, 2]))
    size = (2 * reach + 1,) * 2
    levels = [0.0, 0.25, 0.5, 1.0, rng.uniform(0.0, 1.5)]
    A = rng.choice(levels, size) * (rng.random(size) < rng.uniform(0.1, 1.0))
    A[reach, reach] = rng.choice([1.2, 1.5, 2.0, 3.0, 4.0, rng.uniform(1.05, 5.0)])
    B = rng.choice([0.0, 0.5, 1.0, 4.0, -1.0, 2.0 * rng.normal()], (3, 3))
    if rng.random() < 0.5:
        B = np.zeros((3, 3))
        B[1, 1] = rng.choice([0.5, 1.0, 2.0, 4.0])
    shape = tuple(rng.integers(reach, 9, 2).tolist())
    template = cnnum.Template(
        "drawn",
        A,
        B,
        float(rng.choice([0.0, -1.0, 1.0, 0.5, 3.0, -3.0, 4.0 * rng.normal()])),
        tau=float(rng.choice([1.0, 0.5, 3.0])),
        boundary=[float(rng.choice([-1.0, 0.0, 1.0, 0.3, 2.0])), "zero-flux", "periodic"][
            rng.integers(3)
        ],
        input_boundary=[float(rng.choice([-1.0, 0.0, 0.3])), "zero-flux", "periodic"][
            rng.integers(3)
        ],
    )
    signs = np.where(rng.random(shape) < rng.random(), 1.0, -1.0)
    starts = [np.ones(shape), -np.ones(shape), signs, signs * rng.uniform(1.0, 3.0, shape)]
    picture = np.where(rng.random(shape) < rng.random(), 1.0, -1.0)
    maps = {
        "input": picture if rng.random() < 0.7 else rng.uniform(-1.0, 1.0, shape),
        "state": starts[rng.integers(4)],
    }
    if rng.random() < 0.3:
        maps["mask"] = rng.random(shape) < 0.3
    if rng.random() < 0.3:
        maps["bias"] = 2.0 * rng.normal(size=shape)
    return template, maps


def states(template, maps, times):
    """Return the states at some times, by SciPy."""
    shape = maps["state"].shape
    A, B, tau = template.A[0, 0], template.B[0, 0], float(template.tau[0])
    name, control = template.boundary.name, template.input_boundary.name
    name = float(np.clip(name, -1.0, 1.0)) if isinstance(name, float) else name
    drive = correlated(B, maps["input"], control) + template.z[0] + maps.get("bias", 0.0)
    moves = ~maps.get("mask", np.zeros(shape, dtype=bool))

    def rates(_, x):
        x = x.reshape(shape)
        pull = correlated(A, np.clip(x, -1.0, 1.0), name) + drive - x
        return (moves * pull / tau).ravel()

    way = (0.0, times[-1])
    options = {"method": "LSODA", "rtol": 1e-8, "atol": 1e-9, "t_eval": times}
    found = solve_ivp(rates, way, maps["state"].ravel(), **options)
    return [state.reshape(shape) for state in found.y.T]


def test_ends_are_those_that_scipy_comes_to():
    engine = cnnum.Engine("numba")
    tried = proven = 0
    end = time.monotonic() + SECONDS / 8
    while tried < 16 or time.monotonic() < end:
        template, maps = drawn((31, tried))
        tried += 1
        try:
            found = engine.run(template, **maps, method="wavefront")
        except MethodError:
            continue
        proven += 1
        assert found.method == "wavefront"
        assert (found.output == np.clip(found.state, -1.0, 1.0)).all()
        ends = float(found.time)
        times = [ends + later * float(template.tau[0]) for later in LATER]
        at_end, *later = states(template, maps, times)
        assert (np.abs(at_end) > 1.0 - NUMERIC).all(), (tried, template)
        assert (np.sign(at_end) == found.output).all(), (tried, template)
        for moment, state in zip(times[1:], later, strict=True):
            stopped = engine.run(template, **maps, method="wavefront", duration=moment)
            assert np.abs(state - stopped.state).max() <= float(stopped.error) + NUMERIC, tried
        assert np.abs(later[-1] - found.state).max() <= NUMERIC + 40.0 * np.exp(-LATER[-1])
    assert proven > 0.6 * tried


@pytest.mark.parametrize("shape", [(1, 1), (1, 17), (40, 33), (3, 40, 33), (300, 300)])
def test_pictures_are_those_of_scipy(shape):
    """Holes and propagation are what they are in mathematical morphology."""
    engine = cnnum.Engine("numba")
    rng = np.random.default_rng(5)
    black = rng.random(shape) < 0.55
    picture = np.where(black, 1.0, -1.0)
    cross = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], dtype=bool)
    frames = [black] if black.ndim == 2 else list(black)
    filled = np.array([binary_fill_holes(one, cross) for one in frames]).reshape(shape)
    holes = engine.run("HOLE", input=picture)
    assert ((holes.output > 0.0) == filled).all()
    marks = np.where(black & (rng.random(shape) < 0.02), 1.0, -1.0)
    kept = engine.run("RECALL", input=picture, state=marks)
    whole = np.ones((3, 3), dtype=bool)
    seen = list(marks.reshape(-1, *shape[-2:]) > 0.0)
    grown = [binary_propagation(m, whole, mask=one) for m, one in zip(seen, frames, strict=True)]
    assert ((kept.output > 0.0) == np.array(grown).reshape(shape)).all()
    for result in (holes, kept):
        assert result.method == "wavefront"
        assert result.ways[-1] == "wavefront"
        assert result.settled.all()
        assert float(result.error.max()) < 1e-12
        assert (result.certified == "proven").all()
        assert (result.stability == "stable").all()
        assert not result.decision.open.any()
        assert result.decision.saturated.all()


def test_the_drive_is_the_sum_that_numpy_has():
    """Every kind of rim, on arrays as small as the neighbourhood, of both types of numbers."""
    for seed in range(40):
        rng = np.random.default_rng((5, seed))
        reach = int(rng.integers(1, 4))
        shape = tuple(rng.integers(reach, 9, 2).tolist())
        kernel = rng.normal(size=(2 * reach + 1,) * 2) * (rng.random((2 * reach + 1,) * 2) < 0.6)
        boundary = [-0.7, 0.0, "zero-flux", "periodic"][seed % 4]
        u, bias = (rng.normal(size=shape).astype(rng.choice(FLOATS)) for _ in range(2))
        kind, z = {"zero-flux": 1, "periodic": 2}.get(boundary, 0), rng.normal()
        rim = (kind, 0.0 if kind else float(boundary))
        places = np.argwhere(kernel) - reach
        taps = (*np.ascontiguousarray(places.T), kernel[kernel != 0.0])
        given = bias if seed % 3 else np.empty((0, 0), bias.dtype)
        drive, largest, most = drive_of(u, given, shape, taps, z, rim)
        wanted = z + correlated(kernel, u.astype(float), boundary) + (bias if given.size else 0.0)
        np.testing.assert_allclose(drive, wanted, rtol=0.0, atol=1e-13, err_msg=str(seed))
        assert (largest, most) == (np.abs(u).max(), np.abs(given).max(initial=0.0))
        for bad in (np.nan, np.inf):
            u[tuple(rng.integers(0, shape))] = bad
            found = drive_of(u, given, shape, taps, z, rim)[1]
            assert np.isnan(found) if np.isnan(bad) else not np.isfinite(found)


def test_a_cell_that_is_held_by_nothing_to_spare_stays():
    """FIGREC leaves a white cell among eight black ones at a rate of just 0."""
    engine = cnnum.Engine("numba")
    ring = -np.ones((9, 14))
    ring[:, :9] = 1.0
    ring[4, 4] = ring[6, 2] = -1.0
    marks = -np.ones((9, 14))
    marks[0, 0] = marks[4, 12] = 1.0  # the second one lies on no object, and falls
    found = engine.run("FIGREC", input=ring, state=marks)
    np.testing.assert_array_equal(found.output, ring)
    assert (found.method, float(found.error) < 1e-12) == ("wavefront", True)
    assert not found.settled
    assert found.stability == "unstable"
    assert found.certified == "proven"
    off = engine.run("FIGREC", input=ring, state=marks, bias=np.full((9, 14), 1e-3))
    assert off.output[6, 2] == 1.0


def test_what_is_not_proven_takes_its_way():
    engine = cnnum.Engine("numba")
    rng = np.random.default_rng(2)
    grey = rng.uniform(-1.0, 1.0, (12, 12))
    assert engine.run("AVERAGE", input=grey).method != "wavefront"
    picture = np.where(rng.random((12, 12)) < 0.5, 1.0, -1.0)
    assert engine.run("HOLE", input=picture, state=grey).method != "wavefront"
    assert engine.run("HOLE", input=picture, method="euler", duration=3.0).method == "euler"
    assert engine.run("HOLE", input=picture, duration=3.0).method != "wavefront"
    long = engine.run("HOLE", input=picture, duration=500.0)
    assert (long.method, float(long.time)) == ("wavefront", 500.0)
    fine = cnnum.Engine("reference").run("HOLE", input=picture)
    assert fine.method != "wavefront"
    assert (fine.output == engine.run("HOLE", input=picture).output).all()


def test_the_same_run_gives_the_same_whatever_was_run_before():
    """A start between −1 and 1 keeps a run ready that takes the way; others do not get it."""
    engine = cnnum.Engine("numba")
    rng = np.random.default_rng(3)
    picture = np.where(rng.random((8, 8)) < 0.5, 1.0, -1.0)
    first = engine.run("HOLE", input=picture, state=np.ones((8, 8)))
    for _ in range(3):
        engine.run("HOLE", input=picture, state=np.full((8, 8), 0.5))
    again = engine.run("HOLE", input=picture, state=np.ones((8, 8)))
    assert (again.method, first) == ("wavefront", again)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"template": "EDGE"}, "other weights of A from 0 up"),
        ({"template": "CCD_HOR"}, "other weights of A from 0 up"),
        ({"dt": 0.1}, "it takes no steps"),
        ({"duration": 1.0, "input": -np.ones((8, 8))}, "its outputs may change until"),
        ({"state": np.zeros((8, 8))}, "a cell begins between −1 and 1"),
        ({"at": [1.0, 2.0]}, "without times in between"),
    ],
)
def test_what_was_asked_for_and_cannot_be_says_so(options, said):
    options = {"template": "HOLE", "input": np.ones((8, 8)), **options}
    with pytest.raises(MethodError, match=said):
        cnnum.Engine("numba").run(options.pop("template"), **options, method="wavefront")


def test_numbers_that_are_none_are_refused():
    engine, none = cnnum.Engine("numba"), "NaN or infinite"
    for bad in (np.nan, np.inf, -np.inf):
        for role in ("input", "state", "bias", "mask"):
            maps = {name: np.ones((300, 300)) for name in ("input", role)}
            maps[role][7, 8] = bad
            said = "numbers down to -inf" if (role, bad) == ("mask", -np.inf) else none
            with pytest.raises(cnnum.errors.ArrayError, match=said):
                engine.run("HOLE", **maps)
        with pytest.raises(cnnum.errors.ArrayError, match=none):
            engine.run("HOLE", input=np.full((300, 300), bad))


def test_masks_hold_cells_wherever_they_are_not_0():
    """As the sentence says that refuses negative ones."""
    maps = {"input": -np.ones((1, 4)), "mask": np.array([[0.3, 1.0, 0.0, 1e-3]])}
    for method in ("auto", "euler"):
        result = cnnum.Engine("numba").run("HOLE", **maps, duration=20.0, method=method)
        np.testing.assert_array_equal(result.output, [[1.0, 1.0, -1.0, 1.0]])
