"""Outputs that are found in one pass are those that the transients come to.

Signs are held against SciPy's integration of an equation that is written here, ranks against a walk
from level to level, and both against the library's own transients on all 512 neighbourhoods.
"""

import os
import pickle
import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import cnnum
from cnnum.engines.numba.one_pass import GREATER, LESSER, comparisons
from cnnum.errors import ArrayError, MethodError
from cnnum.runs.decided import ranks_of, signs_of
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.functions import Table

SECONDS = float(os.environ.get("CNNUM_FUZZ", "0"))
ALL_512 = (
    np.array([[n >> k & 1 for k in range(9)] for n in range(512)]).reshape(-1, 3, 3) * 2.0 - 1.0
)
NUMERIC = 1e-6
"""Of SciPy's integration, in relative tolerances of 1e-9."""


def infinite(template):
    return np.inf if template.duration == "settle" else float(template.duration)


def around(boundary, array, reach):
    edges = [(0, 0)] * (array.ndim - 2) + [(reach, reach)] * 2
    if isinstance(boundary, float):
        return np.pad(array, edges, constant_values=boundary)
    return np.pad(array, edges, "symmetric" if boundary == "zero-flux" else "wrap")


def neighbours(weights, array, boundary):
    """Yield each weight with what it is multiplied by."""
    reach, (rows, cols) = weights.shape[0] // 2, array.shape[-2:]
    wide = around(boundary, array, reach)
    for (i, j), weight in np.ndenumerate(weights):
        yield weight, wide[..., i : i + rows, j : j + cols]


@pytest.mark.parametrize("name", [*cnnum.template_names()])
def test_the_library_decides_as_its_transients_do(name):
    template = cnnum.get_template(name)
    if template.layers > 1:
        return
    begins = "first" if template.initial == "input" else "own"
    signs, ranks = signs_of(template, infinite(template), begins), ranks_of(template)
    if signs is None and ranks is None:
        return
    engine = cnnum.Engine("numba")
    states = {"state": ALL_512[::-1]} if template.initial == -1.0 else {}
    try:
        found = engine.run(name, input=ALL_512, **states, method="decision")
    except MethodError:
        end = engine.run(name, input=ALL_512, **states).state
        assert (np.abs(end) < 1.0 + NUMERIC).any(), "a cell that is gray is the only reason"
        return
    # the steps of ranks chatter by what the pulls of all neighbours do within one
    chatter = 0.0 if ranks is None else 0.01 * (abs(template.z[0]) + 4.0) + NUMERIC
    by_steps = {} if ranks is None else {"method": "euler", "dt": 0.01}
    other = engine.run(name, input=ALL_512, **states, **(by_steps or {"method": "propagator"}))
    assert other.method != found.method
    assert np.abs(found.output - other.output).max() <= chatter
    assert (found.decision.sign == np.sign(found.output)).all()


def test_most_of_the_library_is_decided():
    kinds = [cnnum.get_template(name) for name in cnnum.template_names()]
    assert sum(signs_of(one, infinite(one), "first") is not None for one in kinds) > 100
    assert sum(ranks_of(one) is not None for one in kinds) == 6


def drawn(seed):
    """Return a template whose cells see no other cell, and the maps of a run."""
    rng = np.random.default_rng((7, seed))
    B = rng.choice([0.0, 1.0, -1.0, 0.5, rng.normal()], (rng.choice([1, 3, 5]),) * 2)
    duration = float(rng.choice([0.05, 0.5, 1.0, 3.0, 10.0]))
    template = cnnum.Template(
        "drawn",
        [[float(rng.choice([0.0, 0.5, 1.0, 1.0 + 1e-9, 2.0, 3.0, rng.uniform(-2.0, 4.0)]))]],
        B,
        float(rng.choice([0.0, -1.0, 0.5, 3.0 * rng.normal()])),
        tau=float(rng.choice([1.0, 0.5, 3.0])),
        boundary=0.0,
        input_boundary=[float(rng.choice([-1.0, 0.0, 2.0])), "zero-flux", "periodic"][
            rng.integers(3)
        ],
        initial=[0.0, 1.0, -0.3, "input"][rng.integers(4)],
        duration=duration,
    )
    shape = (2, *rng.integers(5, 9, 2).tolist())
    picture = np.where(rng.random(shape) < 0.5, 1.0, -1.0)
    maps = {"input": picture if rng.random() < 0.7 else rng.uniform(-1.0, 1.0, shape)}
    if rng.random() < 0.2:  # without a control template, from a state whatever the template's own
        template, maps = replace(template, B=None), {"state": maps["input"]}
    elif rng.random() < 0.3:
        maps["state"] = rng.choice([-1.0, 1.0, 0.2], shape)
    kind = rng.choice([np.float32, np.float64])
    return template, {name: array.astype(kind) for name, array in maps.items()}


def ends(template, maps, duration):
    """Return the states at a time, by SciPy."""
    u = maps.get("input", maps.get("state")).astype(float)
    begun = u if template.initial == "input" else np.full(u.shape, template.initial)
    begun = maps.get("state", begun)
    name = template.input_boundary.name
    weights = template.B[0, 0] if template.inputs else np.zeros((1, 1))
    drive = sum(w * seen for w, seen in neighbours(weights, u, name)) + template.z[0]
    own, tau = template.A.item(), template.tau[0]

    def rates(_, x):
        return (own * np.clip(x, -1.0, 1.0) - x + drive.ravel()) / tau

    found = solve_ivp(rates, (0.0, duration), begun.ravel(), method="LSODA", rtol=1e-9, atol=1e-10)
    return found.y[:, -1].reshape(u.shape)


def test_signs_are_those_of_scipy():
    engine = cnnum.Engine("numba")
    tried = decided = 0
    end = time.monotonic() + SECONDS / 8
    while decided < 8 or time.monotonic() < end:
        template, maps = drawn(tried)
        tried += 1
        state = ends(template, maps, template.duration)
        try:
            found = engine.run(template, **maps, method="decision")
        except MethodError:
            gray = np.abs(state).min() < 1.0 + 1e-3  # by far more than the margin of roundings
            assert gray, (tried, template)
            continue
        decided += 1
        assert (np.abs(state) > 1.0 - NUMERIC).all(), (tried, template)
        assert (np.sign(state) == found.output).all(), (tried, template)
        later = ends(template, maps, template.duration + 2.0 * template.tau[0])
        assert (np.sign(later) == found.output).all(), (tried, template)
        np.testing.assert_allclose(found.state, state, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("initial", ["input", 0.0, 0.5, -1.0, 1.0])
def test_a_state_that_is_given_is_the_start_whatever_the_template_has(initial):
    """Of templates without an input, also where `auto` decides by itself."""
    start = np.where(np.random.default_rng(2).random((2, 64, 64)) < 0.5, 0.8, -0.8)
    for own, bias in ((2.0, 0.3), (1.0, -0.4), (3.0, 1.2)):
        template = cnnum.Template("t", [[own]], z=bias, initial=initial, duration=3.0)
        # x' = (own − 1) x + bias in time constants, until the state leaves [−1, 1] for good
        rate = own - 1.0
        grown = np.exp(3.0 * rate)
        far = start * grown + bias * (3.0 if rate == 0.0 else (grown - 1.0) / rate)
        found = cnnum.Engine("numba").run(template, state=start)
        decided = (np.abs(far) > 1.0).all()
        assert (found.method == "decision") == decided
        np.testing.assert_allclose(found.output, np.clip(far, -1.0, 1.0), atol=2e-4)


def test_cells_without_a_drive_stay_where_they_begin():
    """Also where the drive is so small that single precision has no such number."""
    engine, start = cnnum.Engine("numba"), GRAY.astype(np.float32)
    for control, maps in ((None, {"state": start}), ([[0.0]], {"input": start})):
        still = cnnum.Template("still", [[1.0]], control, initial="input")
        np.testing.assert_array_equal(engine.run(still, **maps).output, start)
    weak = cnnum.Template("weak", [[1.0]], [[1e-50]], initial=0.0)
    with pytest.raises(MethodError, match="too close to tell"):
        engine.run(weak, input=start, method="decision")


def test_pictures_that_look_unusual_are_spoken_of(caplog):
    """As where a run takes its way."""
    engine, black = cnnum.Engine("numba"), BLOBS > 0.0
    engine.run("LOGAND", input=BLOBS)
    engine.run("MEDIAN", input=black.astype(float))
    engine.run("EDGE", input=np.repeat(BLOBS[..., np.newaxis], 3, axis=-1))
    for said, record in zip(
        ("no state is given", "holds only 0 and 1", "has the shape"), caplog.records, strict=True
    ):
        assert said in record.getMessage()
    still = cnnum.Template("still", [[2.0]], initial="input")
    with pytest.raises(ArrayError, match="leave out the input"):
        engine.run(still, input=BLOBS, state=BLOBS)


def pulled(seed):
    """Return a template whose cells neighbours pull by steps, and a picture."""
    rng = np.random.default_rng((8, seed))
    reach = int(rng.choice([1, 1, 2]))
    weights = (rng.random((2 * reach + 1,) * 2) < rng.uniform(0.2, 1.0)) * rng.choice(
        [0.5, 1.0, 0.3]
    )
    weights[reach, reach] *= rng.random() < 0.3
    edge, pull, count = float(rng.choice([0.0, 0.01, -0.25])), 1.0, np.count_nonzero(weights)
    way = rng.random() < 0.5
    values = (pull, -pull) if way else (-pull, pull)
    z = float(rng.choice([0.0, 0.0, 1.0, -2.5])) * weights.max() + 0.0
    if rng.random() < 0.4:
        z = float(rng.choice([-1.0, 1.0])) * count * weights.max()
    coupling = NonlinearCoupling(
        weights, Table("constant", ((edge, values[0]), (3.0, values[1]))), "u", "x",
        reversed_sign=not way,
    )  # fmt: skip
    template = cnnum.Template(
        "pulled", [[1.0]], None, z, nonlinear=[coupling], initial=["input", 0.25][rng.integers(2)],
        boundary=[-1.0, "zero-flux", "periodic"][rng.integers(3)], duration=40.0, tau=0.5,
    )  # fmt: skip
    u = (
        rng.choice([-1.0, 0.0, 0.4, 1.0], (6, 7))
        if rng.random() < 0.3
        else rng.uniform(-1, 1, (6, 7))
    )
    return template, u.astype(rng.choice([np.float32, np.float64]))


def rests(template, u):
    """Go from level to level, cell by cell, up or down until the pull turns."""
    (coupling,), z = template.nonlinear, template.z[0]
    below, above = (value for _, value in coupling.table.points)
    shift = coupling.table.points[0][0]
    if coupling.reversed_sign:
        below, above, shift = above, below, -shift
    seen = [
        p for w, p in neighbours(coupling.weights, u.astype(float), template.boundary.name) if w
    ]
    levels, size = np.stack(seen) + shift, coupling.weights.max()
    start = u.astype(float) if template.initial == "input" else np.full(u.shape, template.initial)

    def pull(x, cell):
        return z + size * sum(above if x > t else below for t in cell)

    out = np.empty(u.shape)
    for place in np.ndindex(u.shape):
        cell, x = levels[(slice(None), *place)], start[place]
        stops = np.sort(cell)
        tiny = 1e-12
        if pull(x + tiny, cell) > tiny:
            stop = [t for t in stops if t > x and pull(t + tiny, cell) <= tiny]
            x = stop[0] if stop else 9.0
        elif pull(x - tiny, cell) < -tiny:
            stop = [t for t in stops if t < x and pull(t - tiny, cell) >= -tiny]
            x = stop[-1] if stop else -9.0
        out[place] = np.clip(x, -1.0, 1.0)
    return out


def test_ranks_are_those_of_levels():
    engine, decided = cnnum.Engine("numba"), 0
    for seed in range(24 + int(SECONDS)):
        template, u = pulled(seed)
        ranks = ranks_of(template)
        if ranks is None or ranks.time * 0.5 > 40.0:  # pulls of 0.3 have sums of nearly 0
            continue
        decided += 1
        found = engine.run(template, input=u, method="decision")
        np.testing.assert_allclose(found.output, rests(template, u), atol=1e-9, err_msg=str(seed))
        if decided % 8 == 0:
            steps = engine.run(template, input=u, method="euler", dt=0.0025)
            most = 0.005 * (abs(template.z[0]) + template.nonlinear[0].weights.sum())
            assert np.abs(steps.output - found.output).max() <= most, seed
            inner = np.abs(found.output) < 1.0
            assert (found.state == found.output)[inner].all()
    assert decided > 10


@pytest.mark.parametrize("count", [*range(1, 26)])
def test_a_sorting_network_keeps_what_its_ranks_need(count):
    """Comparisons that keep both, the lesser or the greater number, as NumPy sorts them."""
    rng = np.random.default_rng(count)
    for wanted in [*((k, -1) for k in range(count)), *rng.integers(0, count, (6, 2)).tolist()]:
        first, lone, later = comparisons(count, tuple(wanted))
        given = rng.integers(0, count, (200, count)).astype(float)  # with equal ones
        near = np.full(given.shape, np.nan)
        touched = [*first[:, :2].ravel().tolist(), *lone.tolist()]
        assert sorted(touched) == list(range(count))
        near[:, lone] = given[:, lone]
        for source, network in ((given, first), (near, later)):
            for i, j, keeps in network:
                low, high = np.minimum(*source[:, [i, j]].T), np.maximum(*source[:, [i, j]].T)
                near[:, i] = low if keeps & LESSER else np.nan
                near[:, j] = high if keeps & GREATER else np.nan
        for rank in wanted:
            if rank >= 0:
                np.testing.assert_array_equal(near[:, rank], np.sort(given)[:, rank])


def test_the_middle_of_eight_is_so_for_all_zeros_and_ones():
    """A network of minima and maxima is right if it is for these (zero-one principle, Knuth 3)."""
    from cnnum.engines.numba import one_pass

    bits = np.arange(256)[:, None] >> np.arange(8) & 1
    places = np.array([(r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if r or c])
    pictures = np.zeros((256, 3, 3))
    pictures[:, places[:, 0] + 1, places[:, 1] + 1] = 2.0 * bits - 1.0
    fourth, fifth = np.sort(pictures.reshape(256, 9)[:, [0, 1, 2, 3, 5, 6, 7, 8]])[:, 3:5].T
    for kind in (np.float32, np.float64):
        found = one_pass.ranks(pictures.astype(kind), 0.25, places, (3, 4), 0.0, (1, 0.0))
        assert found is not None
        np.testing.assert_array_equal(found[0][:, 1, 1], np.clip(0.25, fourth, fifth))


BLOBS = np.where(np.random.default_rng(3).random((70, 80)) < 0.5, 1.0, -1.0)
GRAY = np.random.default_rng(4).uniform(-1.0, 1.0, (70, 80))


def test_what_a_scene_does_not_need_is_left_out(fast):
    """State and error are made when they are read, of the maps as they were."""
    picture = BLOBS.copy()
    found = fast.run("EDGE", input=picture)
    assert (found.method, found.ways) == ("decision", ("decided",))
    assert found.later is not None
    whole = fast.run("EDGE", input=picture, method="propagator")
    picture[:] = 0.0
    assert found.decision.saturated.all()
    assert found.decision.at_rest.all()
    assert found.later is not None
    np.testing.assert_array_equal(found.output, whole.output)
    np.testing.assert_array_equal(found.state, whole.state)
    assert found.later is None
    assert (found.error, found.time, found.steps) == (whole.error, whole.time, whole.steps)
    again = fast.run("EDGE", input=BLOBS)
    assert pickle.loads(pickle.dumps(again)) == found
    assert not again.output.flags.writeable


@pytest.mark.parametrize(
    ("template", "how"),
    [
        ("EDGE", {"input": GRAY}),
        ("EDGE", {"input": BLOBS, "duration": 0.05}),
        ("EDGE", {"input": BLOBS, "dt": 0.1}),
        ("EDGE", {"input": BLOBS, "bias": 0.1 * BLOBS}),
        ("EDGE", {"input": BLOBS, "mask": BLOBS > 0.0}),
        ("EDGE", {"input": BLOBS[:8, :8]}),
        ("MAX", {"input": GRAY, "duration": 1.9}),
        ("MEDIAN", {"input": GRAY, "state": GRAY}),
        ("HOLE", {"input": BLOBS}),
        ("DIFFUS", {"input": GRAY}),
    ],
)
def test_what_is_not_proven_takes_its_way(template, how):
    engine = cnnum.Engine("numba")
    assert engine.run(template, **how).method != "decision"
    assert cnnum.Engine("reference").run("EDGE", input=BLOBS).method != "decision"


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"input": GRAY}, "between −1 and 1"),
        ({"input": BLOBS, "dt": 0.1}, "no steps"),
        ({"input": BLOBS, "duration": 0}, "a duration above 0"),
        ({"input": BLOBS, "mask": BLOBS > 0.0}, "no other map"),
        ({"input": BLOBS, "template": "HOLE"}, "see no other cell"),
        ({"input": GRAY, "template": "MAX", "duration": 1.0}, "may change until 2"),
        ({"input": BLOBS.tolist()}, "float32 or float64"),
        ({"input": BLOBS, "at": [1.0, 2.0]}, "without times in between"),
    ],
)
def test_what_was_asked_for_and_cannot_be_says_so(how, said):
    how = {"template": "EDGE", **how}
    with pytest.raises(MethodError, match=said):
        cnnum.Engine("numba").run(how.pop("template"), **how, method="decision")


def test_numbers_that_are_none_are_refused_as_ever():
    engine = cnnum.Engine("numba")
    for name in ("EDGE", "MEDIAN"):
        for bad in (np.nan, np.inf, -np.inf):
            picture = np.ones((300, 300))
            picture[7, 8] = bad
            with pytest.raises(ArrayError, match="NaN or infinite"):
                engine.run(name, input=picture)
        with pytest.raises(ArrayError, match="as_picture"):
            engine.run(name, input=np.round(127.5 * (1.0 + GRAY)))


def test_all_cores_give_what_one_gives(monkeypatch):
    from cnnum.engines.numba import one_pass

    engine, rng = cnnum.Engine("numba"), np.random.default_rng(5)
    black = np.where(rng.random((3, 250, 190)) < 0.5, np.float32(1.0), np.float32(-1.0))
    gray = rng.uniform(-1.0, 1.0, (3, 250, 190))
    ran = [engine.run("EDGE", input=black).output, engine.run("MEDIAN", input=gray).output]
    monkeypatch.setattr(one_pass, "SHARED", 1)
    monkeypatch.setattr(one_pass, "most_cores", lambda: 7)
    for name, picture, before in zip(("EDGE", "MEDIAN"), (black, gray), ran, strict=True):
        found = engine.run(name, input=picture)
        assert found.method == "decision"
        np.testing.assert_array_equal(found.output, before)
    mean = [seen for _, seen in neighbours(np.ones((3, 3)), black.astype(float), "zero-flux")]
    np.testing.assert_array_equal(ran[0] > 0.0, (black > 0.0) & (np.sum(mean, axis=0) < 9.0))
