"""ON and OFF answers: one at every rate, none to an even load, and on lines of taxels."""

import numpy as np
import pytest

import cnnum
from cnnum.errors import ProgramError

MAPS = ["on_sustained", "off_sustained", "on_transient", "off_transient"]


def played(signal, rate, *, needs=MAPS, engine="numba", **parameters):
    frames = np.zeros((*signal.shape, 3))
    frames[..., 2] = signal
    program = cnnum.get_program("on_off").bind(push=1.0, rate=rate, rest=0.8, **parameters)
    precision = "float64" if engine == "numba" else None
    stream = cnnum.Engine(engine, precision=precision).compile(program, signal.shape[1:], needs)
    stream = stream.stream()
    outputs = [stream.push(frame) for frame in frames]
    return {name: np.array([out[name] for out in outputs]) for name in needs}


def press(rate, size):
    time = np.arange(round(2.0 * rate) + 1) / rate
    return time, np.clip(time - 1.0, 0.0, 0.3)[:, None, None] * size


def test_a_press_has_the_same_answers_at_every_rate():
    """Its corners lie on frames of all rates, and it is straight between them: exact."""
    size = np.random.default_rng(1).uniform(0.0, 1.0, (3, 5))
    coarse = played(press(10.0, size)[1], 10.0)
    assert coarse["on_sustained"][-1].max() > 0.05
    for rate in (50.0, 200.0, 1000.0):
        fine = played(press(rate, size)[1], rate)
        for name in MAPS:
            every = fine[name][:: round(rate / 10.0)]
            np.testing.assert_allclose(every, coarse[name], atol=1e-9)


def test_an_even_load_has_no_sustained_answer():
    _, signal = press(50.0, np.ones((4, 4)))
    found = played(signal, 50.0)
    for name in MAPS:
        assert found[name][-1].max() < 1e-3
    # while it comes the surround is late by its time constant: ON by slope · 0.03 s
    assert found["on_sustained"].max() == pytest.approx(0.03, rel=1e-3)
    assert found["on_transient"].max() > 0.01
    assert found["off_sustained"].max() < 1e-9


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (4, 4)])
def test_every_engine_and_array_agrees(shape):
    size = np.random.default_rng(sum(shape)).uniform(0.2, 1.0, shape)
    signal = press(20.0, size)[1]
    needs = [*MAPS, "comes", "goes"]
    exact = played(signal, 20.0, needs=needs, engine="reference")
    assert exact["comes"].any()
    for engine in ("numba", "opencl"):
        found = played(signal, 20.0, needs=needs, engine=engine)
        for name in needs[:5]:
            np.testing.assert_allclose(found[name], exact[name], atol=1e-5, err_msg=name)


def test_bad_parameters_are_refused():
    with pytest.raises(ProgramError, match="surround"):
        cnnum.get_program("on_off").bind(surround=0.0).trace((4, 4), ("normal",))
