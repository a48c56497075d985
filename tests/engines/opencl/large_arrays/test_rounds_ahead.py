"""Rounds that are launched before the host knows whether they are needed change nothing."""

import numpy as np

import cnnum

SHAPE = (257, 258)
"""More cells than one kernel takes."""

ROUNDS = (3, 40, 17, 150)
LIMIT = 100


@cnnum.program
def counting(frame):
    """Count up in every cell to a number of its own, at most to the limit."""
    wanted = frame.channel("wanted")
    run = cnnum.loop(lambda count: count + (count < wanted), 0.0 * wanted, limit=LIMIT)
    return {"count": run.value, "rounds": run.iterations, "finished": run.finished}


def test_loops_end_where_frames_and_limits_say():
    rng, frames = np.random.default_rng(2), np.zeros((len(ROUNDS), *SHAPE, 1))
    for frame, most in zip(frames, ROUNDS, strict=True):
        frame[...] = rng.integers(0, most + 1, (*SHAPE, 1))
        frame[5, 7] = most
    plan = cnnum.Engine("opencl").compile(counting, SHAPE, channels=("wanted",))
    for given in (frames, frames[1:2], frames[3:]):
        results = plan(given)
        most = given.max(axis=(1, 2, 3))
        np.testing.assert_array_equal(results["count"], np.minimum(given[..., 0], LIMIT))
        # the round that changes nothing is the last
        np.testing.assert_array_equal(results["rounds"], np.minimum(most + 1, LIMIT))
        np.testing.assert_array_equal(results["finished"], most + 1 <= LIMIT)


def test_adaptive_steps_of_a_batch_are_those_of_each_frame():
    template = cnnum.Template(
        "waves", A=[[0.0, 1.0, 0.0], [1.0, 2.0, 1.0], [0.0, 1.0, 0.0]], z=0.1, initial="input",
        duration=3.0, boundary="zero-flux",
    )  # fmt: skip
    rng, engine = np.random.default_rng(4), cnnum.Engine("opencl")
    # stiffer frames take more steps
    states = rng.uniform(-1.0, 1.0, (3, *SHAPE)) * np.array([1e-3, 1.0, 30.0])[:, None, None]
    run = {"method": "dormand-prince"}
    batch = engine.run(template, state=states, **run)
    assert len(set(np.asarray(batch.steps).tolist())) == 3
    assert np.min(batch.steps) > 16
    for state, output, steps in zip(states, batch.state, np.asarray(batch.steps), strict=True):
        alone = engine.run(template, state=state, **run)
        np.testing.assert_array_equal(alone.state, output)
        assert alone.steps == steps
