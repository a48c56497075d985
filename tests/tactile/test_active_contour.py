"""The active contour: speed of its front, one of two bodies, a faulty frame, and small arrays."""

import numpy as np
import pytest

import cnnum
from cnnum.errors import PhysicsError, ProgramError
from cnnum.templates.tactile.active_contour import (
    AT_REST,
    BIAS,
    CELL_TIME,
    CENTRE,
    RING,
    front_time,
)


def played(load, *, engine="numba", needs=("contour_inside", "contour_rests"), **parameters):
    """Return outputs of every frame after 20 of rest, under loads (frames, rows, cols)."""
    rng = np.random.default_rng(0)
    frames = 1e-4 * rng.normal(size=(20 + len(load), *load.shape[1:], 3))
    frames[20:, ..., 2] += load
    program = cnnum.get_program("active_contour").bind(reads="force", push=1.0, **parameters)
    stream = (
        cnnum.Engine(engine)
        .compile(program, load.shape[1:], list(needs))
        .stream(rate=parameters.get("rate", 200.0))
    )
    outputs = [stream.push(frame) for frame in frames][20:]
    return {name: np.array([out[name] for out in outputs]) for name in needs}


@pytest.mark.parametrize("engine", ["reference", "numba", "opencl"])
def test_a_plane_front_moves_a_cell_in_the_time_of_the_closed_form(engine):
    """After the time of ten cells more, the states are those of before, ten cells on."""
    start = np.full((3, 40), -AT_REST)
    start[:, :6] = AT_REST
    template = cnnum.get_template("contour_wave")
    first, later = (
        cnnum.Engine(engine).run(template, state=start, duration=n * CELL_TIME, rtol=1e-6).state
        for n in (8, 18)
    )
    # a front never forgets the errors of its steps; a cell late is off by 2
    np.testing.assert_allclose(later[:, 18:30], first[:, 8:20], atol=2e-2)
    assert (later[1] > 0).sum() == (first[1] > 0).sum() + 10


def test_the_time_of_a_cell_follows_the_weights():
    for centre, ring, bias in ((CENTRE, RING, BIAS), (5.0, 0.25, 5.7), (5.0, 0.3, 5.85)):
        takes = front_time(centre, ring, bias)
        kernel = np.full((3, 3), ring)
        kernel[1, 1] = centre
        template = cnnum.Template("own", kernel, z=bias, boundary="zero-flux", duration=1.0)
        rest = centre + 8 * ring - bias
        start = np.full((3, 40), -rest)
        start[:, :6] = rest
        engine = cnnum.Engine("reference")
        first, later = (
            engine.run(template, state=start, duration=n * takes).state for n in (8, 18)
        )
        np.testing.assert_allclose(later[1, 18:30], first[1, 8:20], atol=2e-2)
    for wrong in ((3.0, 0.25, 3.75), (4.0, 0.25, 3.0), (4.0, 0.25, 6.0)):
        with pytest.raises(PhysicsError, match="front"):
            front_time(*wrong)


@pytest.mark.parametrize("rate", [50.0, 200.0, 1000.0])
def test_the_contour_spreads_at_its_speed_at_every_rate(rate):
    """A front along a wide load, cells a second, from its peak at one end."""
    speed, seconds = 20.0, 0.6
    load = np.ones((round(seconds * rate), 3, 24))
    load[..., 0] = 1.5
    inside = played(load, rate=rate, speed=speed)["contour_inside"][:, 1].sum(axis=1)
    time = np.arange(len(inside)) / rate
    # a plane front, once the column of the peak is taken; a frame moves it by 0.4 cells at most
    middle = (time > 0.2) & (inside < 22)
    slope = np.polyfit(time[middle], inside[middle], 1)[0]
    assert slope == pytest.approx(speed, rel=0.05)


def test_it_stays_with_its_body_when_another_one_touches():
    load = np.zeros((60, 6, 12))
    load[:, 1:5, 1:5], load[:, 2, 2] = 1.0, 1.2
    load[20:, 1:5, 7:11] = 1.4
    found = played(load)
    np.testing.assert_array_equal(found["contour_inside"][-1] > 0, load[0] > 0)
    assert found["contour_rests"][-1]


def test_it_follows_a_body_and_a_faulty_frame_moves_it_little():
    load = np.zeros((300, 8, 20))
    for n in range(300):
        at = 2 + n // 20
        load[n, 2:6, at : at + 4] = 1.0
    load[150] = load[150, :, ::-1]  # one frame the other way round
    found = played(load)["contour_inside"] > 0
    for n in (139, 155, 179, 299):
        np.testing.assert_array_equal(found[n], load[n] > 0)
    assert (found[150] & (load[149] > 0)).any()


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (5, 6)])
def test_every_engine_and_array_agrees(shape):
    load = np.zeros((30, *shape))
    load[:, : max(1, shape[0] - 1), : max(1, shape[1] - 1)] = 1.0
    load[:, 0, 0] = 1.3
    needs = ["contour_inside", "contour", "contour_rests", "contour_area"]
    found = {e: played(load, engine=e, needs=needs) for e in ("reference", "numba", "opencl")}
    for name in needs:
        for engine in ("numba", "opencl"):
            np.testing.assert_array_equal(found[engine][name][-1], found["reference"][name][-1])
    np.testing.assert_array_equal(found["numba"]["contour_inside"][-1] > 0, load[-1] > 0)


def test_bad_parameters_are_refused():
    program = cnnum.get_program("active_contour").bind(speed=0.0)
    with pytest.raises(ProgramError, match="speed"):
        program.trace((4, 4), ("shear_x", "shear_y", "normal"))
