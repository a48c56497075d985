"""Flow and direction of patterns that move, and the spread of a contact's area."""

import numpy as np
import pytest

import cnnum
from cnnum.errors import ProgramError
from cnnum.scenes.pipeline import load_scene

RATES = [50.0, 200.0, 1000.0]


def last(name, signal, needs, *, engine="numba", **parameters):
    """Return outputs of the last frame of a push (frames, rows, cols)."""
    frames = np.zeros((*signal.shape, 3))
    frames[..., 2] = signal
    program = cnnum.get_program(name).bind(push=1.0, rest=0.0, **parameters)
    precision = "float64" if engine == "numba" else None
    plan = cnnum.Engine(engine, precision=precision).compile(program, signal.shape[1:], needs)
    stream, out = plan.stream(), {}
    for frame in frames:
        out = stream.push(frame)
    return out


def blob(rate, velocity, *, grows=0.0, cells=12, seconds=1.5):
    """A round load that moves, and grows by a factor a second."""
    time = np.arange(round(seconds * rate))[:, None, None] / rate
    rows, cols = np.indices((cells, cells))
    x = cols - cells / 2 + 0.5 - velocity[0] * (time - seconds)
    y = rows - cells / 2 + 0.5 - velocity[1] * (time - seconds)
    load = np.exp(-(x**2 + y**2) / 5.0 + grows * time)
    load[:8] = 0.0
    return load


@pytest.mark.parametrize("rate", RATES)
def test_the_flow_of_a_blob_is_its_velocity_at_every_rate(rate):
    for velocity in ((1.5, -0.8), (-0.4, 2.0)):
        needs = ["flow_x", "flow_y", "flow_explains"]
        found = last("tactile_flow", blob(rate, velocity), needs, rate=rate)
        # five taxels of slope on a blob of 1.6 cells: 2 %
        np.testing.assert_allclose([found["flow_x"], found["flow_y"]], velocity, atol=0.06)
        assert found["flow_explains"] > 0.95


def test_a_load_that_grows_does_not_flow():
    needs = ["flow_x", "flow_y", "flows"]
    for rate in RATES:
        found = last("tactile_flow", blob(rate, (0.0, 0.0), grows=4.0), needs, rate=rate, still=0.1)
        assert np.hypot(found["flow_x"], found["flow_y"]) < 1e-3
        assert not found["flows"]
    both = last("tactile_flow", blob(200.0, (1.5, 0.5), grows=2.0), needs, rate=200.0)
    np.testing.assert_allclose([both["flow_x"], both["flow_y"]], [1.5, 0.5], atol=0.06)


@pytest.mark.parametrize("unit", [1e-9, 1e6])
@pytest.mark.parametrize("engine", ["numba", "opencl"])
def test_the_flow_does_not_depend_on_the_unit_of_the_load(unit, engine):
    """Squares and their squares of small numbers leave single precision."""
    needs = ["flow_x", "flow_y", "flow_known", "flow_map_x"]
    load = unit * blob(200.0, (1.5, -0.8))
    found = last("tactile_flow", load, needs, rate=200.0, engine=engine)
    assert found["flow_known"]
    np.testing.assert_allclose([found["flow_x"], found["flow_y"]], [1.5, -0.8], atol=0.06)
    # where the blob is
    np.testing.assert_allclose(found["flow_map_x"][4:8, 4:8], 1.5, atol=0.1)


def test_the_flow_of_a_place_is_that_of_what_is_there():
    """Two gratings side by side that move apart."""
    rate, k = 200.0, np.pi / 4
    time, cols = np.arange(200)[:, None, None] / rate, np.arange(24)
    way = np.where(cols < 12, -1.0, 1.0)
    signal = np.cos(k * (cols - way * 2.0 * time)) + np.zeros((200, 8, 1))
    signal[:8] = 0.0
    found = last("tactile_flow", signal, ["flow_map_x", "flow_map_y"], rate=rate, window=1.0)
    np.testing.assert_allclose(found["flow_map_x"][2:-2, 3:9], -2.0, rtol=0.05)
    np.testing.assert_allclose(found["flow_map_x"][2:-2, 15:21], 2.0, rtol=0.05)
    assert np.abs(found["flow_map_y"]).max() < 0.1


@pytest.mark.one_in(3)
@pytest.mark.parametrize("cells", [8, 12, 16])
def test_gratings_are_as_much_too_fast_as_the_page_says(cells):
    """Any direction, phase and speed; a wave of 3 pitches shows that the flow is lost there."""
    rng, rate = np.random.default_rng(cells), 50.0
    program = cnnum.get_program("tactile_flow").bind(push=1.0, rest=0.0, rate=rate)
    needs = ["flow_x", "flow_y", "flow_map_x", "flow_map_y"]
    plan = cnnum.Engine("numba", precision="float64").compile(program, (cells, cells), needs)
    time, (rows, cols) = np.arange(60)[:, None, None] / rate, np.indices((cells, cells))
    # 81 gratings reached 0.996 to 1.057 and 1.047 to 1.217, aside 0.021 and 0.071, and 1.055 and
    # 1.218 at one taxel
    for wave, least, most, aside, peak in (
        (6, 0.98, 1.08, 0.03, 1.08), (4, 1.03, 1.24, 0.09, 1.24), (3, 1.15, 9, 9, 9)
    ):  # fmt: skip
        for n in range(4):
            turn = n // 2 * np.pi / 2 if n % 2 else rng.uniform(0.0, 2.0 * np.pi)
            speed, phase = rng.uniform(0.5, 5.0), rng.uniform(0.0, 2.0 * np.pi)
            way = np.array([np.cos(turn), np.sin(turn)])
            along = cols * way[0] + rows * way[1] - speed * time
            frames = np.zeros((60, cells, cells, 3))
            frames[8:, ..., 2] = np.cos(2.0 * np.pi / wave * along + phase)[8:]
            stream = plan.stream()
            for frame in frames:
                out = stream.push(frame)
            flow = np.array([float(out["flow_x"]), float(out["flow_y"])]) / speed
            assert least < flow @ way < most, (wave, turn, speed, phase)
            # bars show no motion along them
            assert np.linalg.norm(flow - (flow @ way) * way) < aside, (wave, turn, speed, phase)
            local = way[0] * out["flow_map_x"] + way[1] * out["flow_map_y"]
            assert local[2:-2, 2:-2].max() / speed < peak


@pytest.mark.parametrize("seed", range(3))
def test_the_area_of_a_sphere_spreads_with_its_load_as_hertz_says(seed):
    """dA/dF = 2πa²/(3F), of the simulated array in newtons and cells, with its usual noise."""
    rng = np.random.default_rng(seed)
    load, duration = rng.uniform(1.0, 1.6), rng.uniform(0.4, 1.2)
    changes = {
        "needs": ["spread_area", "area_spread"],
        "program.name": "tactile_flow",
        "array.script": [
            {"kind": "hold", "duration": 0.45},
            {"kind": "press", "duration": duration, "load": load},
        ],
        "array.seed": seed,
        "array.radius": rng.uniform(25e-3, 60e-3),
    }
    checked = 0
    for moment in load_scene("demo", changes=changes).results():
        truth, load = moment.frame.truth, moment.frame.truth["normal_force"]
        area = np.pi * (truth["contact_radius"] / 1.5e-3) ** 2
        if area < 7.0 or moment.number % 10:  # the page has what happens below
            continue
        # the widest of 309 frames of 24 such touches were off by 7 and by 20 %
        assert float(moment.outputs["spread_area"]) == pytest.approx(area, rel=0.08)
        spread = float(moment.outputs["area_spread"])
        assert spread == pytest.approx(2 * area / (3 * load), rel=0.25)
        checked += 1
    assert checked > 3


@pytest.mark.parametrize("rate", RATES)
def test_correlations_give_the_direction_of_a_blob_at_every_rate(rate):
    for velocity in ((4.0, -3.0), (-2.0, 4.0), (0.0, 5.0)):
        load = blob(rate, velocity)
        needs = ["motion_x", "motion_y", "drifts"]
        found = last("motion_direction", load, needs, rate=rate)
        way = np.arctan2(float(found["motion_y"]), float(found["motion_x"]))
        assert np.angle(np.exp(1j * (way - np.arctan2(velocity[1], velocity[0])))) == pytest.approx(
            0.0, abs=0.15
        )
        assert found["drifts"]
    still = last("motion_direction", blob(rate, (0.0, 0.0), grows=4.0), needs, rate=rate)
    assert not still["drifts"]


@pytest.mark.parametrize("name", ["tactile_flow", "motion_direction"])
def test_lines_of_taxels_and_single_ones_run_on_every_engine(name):
    needs = ["flow_x", "flows"] if name == "tactile_flow" else ["motion_x", "drifts"]
    line = blob(50.0, (2.0, 0.0))[:, 6:7]
    exact = last(name, line, needs, engine="reference", rate=50.0)
    assert float(exact[needs[0]]) > 0.1
    for engine in ("numba", "opencl"):
        found = last(name, line, needs, engine=engine, rate=50.0)
        for output in needs:
            assert found[output] == pytest.approx(exact[output], rel=2e-3)
        one = last(name, line[..., 6:7], needs, engine=engine, rate=50.0)
        assert all(abs(one[output]) < 1e-3 for output in needs)


def test_bad_parameters_are_refused():
    channels = ("shear_x", "shear_y", "normal")
    for name, wrong in (("tactile_flow", "look"), ("motion_direction", "delay")):
        with pytest.raises(ProgramError, match=wrong):
            cnnum.get_program(name).bind(**{wrong: 0.0}).trace((4, 4), channels)
