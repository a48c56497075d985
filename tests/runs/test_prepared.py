"""Runs that are prepared once answer as a first run does, and refuse the same arguments."""

import threading

import numpy as np
import pytest

from cnnum import Engine, Template, get_template
from cnnum.errors import ArrayError, MethodError


@pytest.fixture
def engine(opencl):
    """An engine that has prepared nothing yet."""
    return Engine("opencl", device=opencl.device, precision=opencl.precision)


def pictures(count, shape=(8, 8)):
    return np.random.default_rng(5).choice([-1.0, 1.0], (count, *shape))


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("EDGE", {}),
        ("EDGE", {"method": "euler", "dt": 0.05, "duration": 10.0}),
        ("HOLE", {"duration": "settle"}),
        ("AVERAGE", {}),
        ("DIFFUS", {"duration": 1.0}),
    ],
)
def test_a_prepared_run_gives_the_same_bits(engine, name, options):
    template = get_template(name)
    for picture in pictures(4):
        prepared = engine.run(template, input=picture, **options)
        fresh = Engine("opencl", device=engine.device).run(template, input=picture, **options)
        for field in ("output", "state", "time", "steps", "settled", "error"):
            one, other = getattr(prepared, field), getattr(fresh, field)
            np.testing.assert_array_equal(one, other)
            assert one.dtype == other.dtype
        assert (prepared.method, prepared.reason) == (fresh.method, fresh.reason)


def test_results_of_prepared_runs_stay_as_they_are(engine):
    template, (first, second) = get_template("EDGE"), pictures(2)
    engine.run(template, input=first)
    kept = engine.run(template, input=first)
    copy = kept.output.copy()
    engine.run(template, input=second)
    np.testing.assert_array_equal(kept.output, copy)


def test_a_map_more_or_another_type_is_another_run(engine):
    template, (picture, bias) = get_template("EDGE"), pictures(2)
    plain = engine.run(template, input=picture).output
    biased = engine.run(template, input=picture, bias=3.0 * bias).output
    assert not np.array_equal(plain, biased)
    for _ in range(2):
        for like in (
            picture.tolist(),
            picture.astype(np.float32),
            picture[None],
            picture.T.copy().T,
        ):
            np.testing.assert_array_equal(engine.run(template, input=like).output.squeeze(), plain)


def test_a_template_of_the_same_identity_is_not_taken_for_another(engine):
    picture = pictures(1)[0]
    for bias in np.linspace(-2.0, 2.0, 8):  # each lies where the one before it lay
        template = Template(name="one", A=[[0.0]], B=[[1.0]], z=float(bias), duration="settle")
        for _ in range(2):
            state = engine.run(template, input=picture).state
            np.testing.assert_allclose(state, picture + bias, atol=1e-4)  # x settles at B u + z
        del template


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1e39, 1e200])
def test_numbers_out_of_range_are_refused_each_time(engine, wrong):
    template, picture = get_template("EDGE"), pictures(1)[0]
    right = engine.run(template, input=picture).output
    spoiled = picture.copy()
    spoiled[3, 4] = wrong
    for _ in range(3):
        with pytest.raises(ArrayError, match="'input'"):
            engine.run(template, input=spoiled)
    np.testing.assert_array_equal(engine.run(template, input=picture).output, right)


def test_a_run_that_does_not_end_is_refused_each_time(engine):
    grows = Template(name="grows", A=[[3.0]], B=[[1.0]], z=0.0, duration=200.0, output="linear")
    for _ in range(3):
        with pytest.raises((ArrayError, MethodError)):
            engine.run(grows, input=pictures(1)[0])


def test_options_are_checked_each_time(engine):
    template, picture = get_template("EDGE"), pictures(1)[0]
    engine.run(template, input=picture)
    for options in ({"dt": -1.0}, {"duration": [1.0]}, {"rtol": float("nan")}):
        for _ in range(2):
            with pytest.raises(MethodError):
                engine.run(template, input=picture, **options)


def test_threads_take_turns(engine):
    template, inputs = get_template("EDGE"), pictures(64)
    right = [engine.run(template, input=picture).output.copy() for picture in inputs]
    wrong = []

    def work(start):
        for turn in range(200):
            number = (start + turn) % len(inputs)
            got = engine.run(template, input=inputs[number]).output
            if not np.array_equal(got, right[number]):
                wrong.append(number)

    threads = [threading.Thread(target=work, args=(16 * number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_prepared_runs_do_not_pile_up(engine, monkeypatch):
    from cnnum.runs import prepared as room

    monkeypatch.setattr(room, "MOST_PREPARED", 2)
    template, picture = get_template("EDGE"), pictures(1)[0]
    for steps in (1, 2, 3, 4):
        engine.run(template, input=picture, method="euler", dt=0.1, duration=0.1 * steps)
    assert len(engine._open.prepared) == 2
