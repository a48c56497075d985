"""Whole programs as on an analogue array, against the equation with weights of every cell."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import cnnum
from cnnum.errors import MethodError, NotSupportedError

FINE = {"weight_bits": 32, "state_bits": 32}
A = np.array([[0.0, 0.3, 0.0], [0.2, 0.5, 0.1], [0.0, -0.2, 0.0]])
COUPLED = cnnum.Template("coupled", A, [[1.0]], z=0.1, boundary=0.5, duration=2.0)
FIRST = cnnum.Template("first", [[0.0]], [[0.5]], duration="settle", output="linear")


@cnnum.program
def _once(frame):
    return {"y": cnnum.apply(COUPLED, input=frame.normal)}


@cnnum.program
def _twice(frame):
    kept = frame.memory("before")
    y = cnnum.apply(FIRST, input=frame.normal)
    kept.store(y)
    return {"y": y, "moved": y - kept.value, "mean": y.mean()}


def planned(program, shape=(5, 4), **numbers):
    engine = cnnum.Engine("reference")
    chip = cnnum.Chip(**numbers) if numbers else None
    return engine.compile(program, shape, channels=["normal"], chip=chip)


def test_a_fine_chip_is_the_plain_program():
    u = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 5, 4, 1))
    plain, found = planned(_once)(u), planned(_once, **FINE)(u)
    assert np.abs(found["y"] - plain["y"]).max() < 1e-7


def test_feedback_differs_from_cell_to_cell():
    u = np.random.default_rng(1).uniform(-1.0, 1.0, (5, 4))
    chip = cnnum.Chip(**FINE, mismatch=0.1, seed=4)
    # the mismatch of each part, drawn as the chip states: A (1, 1, 3, 3, 5, 4), B, z
    off = {
        part: 1.0 + 0.1 * np.random.default_rng([4, stream]).standard_normal(size)
        for part, stream, size in (
            ("A", 4, (1, 1, 3, 3, 5, 4)),
            ("B", 1, (1, 1, 1, 1, 5, 4)),
            ("z", 2, (1, 5, 4)),
        )
    }
    drive = off["B"][0, 0, 0, 0] * u + off["z"][0] * 0.1

    def rate(_, x):
        y = np.clip(x.reshape(5, 4), -1.0, 1.0)
        near = np.pad(y, 1, constant_values=0.5)
        total = sum(
            A[i, j] * off["A"][0, 0, i, j] * near[i : i + 5, j : j + 4]
            for i in range(3)
            for j in range(3)
        )
        return (drive - x.reshape(5, 4) + total).ravel()

    exact = solve_ivp(rate, (0.0, 2.0), np.zeros(20), rtol=1e-10, atol=1e-12).y[:, -1]
    engine = cnnum.Engine("reference")
    plan = engine.compile(_once, (5, 4), channels=["normal"], chip=chip)
    found = plan(u[..., np.newaxis])["y"]
    # maps of 32 bits, and the solver's own tolerance
    assert np.abs(found - np.clip(exact, -1.0, 1.0).reshape(5, 4)).max() < 1e-7
    plain = planned(_once)(u[..., np.newaxis])["y"]
    assert np.abs(found - plain).max() > 0.01


def test_maps_are_coarse_and_memories_work():
    u = np.array([[1.0, 0.3, -0.6, 0.05]] * 5)[..., np.newaxis]
    plan = planned(_twice, state_bits=4, weight_bits=16)
    stream = plan.stream()
    first, second = stream.push(u), stream.push(0.5 * u)
    held = np.round(7 * u[..., 0]) / 7  # 7 levels up to the largest
    assert np.allclose(first["y"], 0.5 * held, atol=1e-4)
    assert np.allclose(second["moved"], -0.25 * held, atol=1e-4)


def test_noise_is_new_in_every_frame_and_the_same_for_a_seed():
    u = np.random.default_rng(2).uniform(-1.0, 1.0, (40, 30, 1))
    plain = planned(_twice, (40, 30), **FINE)(u)["y"]
    plans = [planned(_twice, (40, 30), **FINE, noise=0.02, seed=seed) for seed in (1, 1, 2)]
    one, same, other = (plan(u)["y"] for plan in plans)
    again = plans[0](u)["y"]
    assert np.array_equal(one, same)
    noise = [(each - plain) / np.abs(plain).max() for each in (one, other, again)]
    for each in noise:
        # σ of 1,200 numbers is known within σ/√2,400: five of them
        assert abs(each.std() - 0.02) < 5 * 0.02 / np.sqrt(2400)
    assert abs(np.corrcoef(noise[0].ravel(), noise[2].ravel())[0, 1]) < 5 / np.sqrt(1200)


def test_other_engines_and_templates_are_refused_in_one_sentence():
    with pytest.raises(NotSupportedError, match=r"Only Engine\('reference'\)"):
        cnnum.Engine("numba").compile(_once, (4, 4), channels=["normal"], chip=cnnum.Chip())
    with pytest.raises(MethodError, match="'chip' must be of the type Chip"):
        cnnum.Engine("reference").compile(_once, (4, 4), channels=["normal"], chip=8)

    @cnnum.program
    def uneven(frame):
        return {"y": cnnum.apply(cnnum.get_template("D_ANISO"), input=frame.normal)}

    with pytest.raises(NotSupportedError, match="linear couplings"):
        planned(uneven, weight_bits=8)
