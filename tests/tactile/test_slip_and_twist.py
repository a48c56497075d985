"""Slip and twist: against plain NumPy, and on noise, slides, turns and recordings."""

import inspect
import os
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import binary_propagation

from cnnum.drivers.simulated.grips import Arrays
from cnnum.drivers.simulated.hands import oblique
from cnnum.drivers.uskin_csv import UskinCsvOptions
from cnnum.errors import ProgramError
from cnnum.lab.scoring.families import bristles
from cnnum.lab.scoring.subjects import side_by_side
from cnnum.programs import program
from cnnum.templates.tactile.shared.loads import RecentLoads
from cnnum.templates.tactile.slip import WAVE, slip
from cnnum.templates.tactile.twist import twist
from cnnum.templating.checks.tactile.slip_and_twist import (
    GO,
    PULL,
    SETTINGS,
    Constants,
    diffused,
    patch,
    played,
    streams,
)
from cnnum.templating.library import get_template

RECORDINGS = Path(os.environ.get("CNNUM_RECORDINGS", "")) / "uskin_grasp"
TRIALS = {
    "02-21-14-10-49": (),
    "02-21-17-22-56": (),
    "02-22-11-23-11": (75,),
    "02-22-15-15-00": (73,),
}
"""Rows of the labelled onsets; a third, at 135, lies within the first report."""

USKIN = {"push": 1.0, "shear_gain": 2.0, "axes": False, "pads": 2, "rate": 55.0}
"""Counts of two pads; 59.8 rows a second, 8 % of which repeat the one before."""

NOISE, SLIDES, TURNS, BACK = range(4)
BOUND = {"rate": SETTINGS.rate}


@pytest.fixture(scope="module")
def four():
    return streams(np.random.default_rng(5), (6, 6))


def both(rates=None, **settings):
    """Slip and twist in one program, which share their first fields; rates of false reports."""

    def fitting(part):
        known = inspect.signature(part.function).parameters
        names = {name for name in settings if name in ("rate", *known)} - {
            "level",
            part is twist and "still",
        }
        bound = part.bind(**{name: settings[name] for name in names})
        return bound.bind(false_reports=rates[part.name]) if rates else bound

    def slip_and_twist(frame):
        return {**fitting(slip)(frame), **fitting(twist)(frame)}

    return program(slip_and_twist)


def agree(got, expected, names, frames=slice(None)):
    for name in names:
        # sums of loads that nearly agree, in single precision: up to 2e-6 is seen
        np.testing.assert_allclose(
            got[name][frames], expected[name][frames], rtol=1e-5, atol=1e-5, err_msg=name
        )


@pytest.mark.parametrize("which", [NOISE, SLIDES, TURNS])
def test_every_frame_is_what_numpy_says(engine, run, four, which):
    frames = four[:, which]
    got = run(engine, both(**asdict(SETTINGS)), frames)
    expected = played(frames, SETTINGS)
    flags = ("gross_slip", "twist", "twist_sense")
    agree(got, expected, (*flags, "slip_strength", "twist_strength"))
    if which != NOISE:
        agree(got, expected, ("twist_row", "twist_column"), slice(PULL, None))
    if which == SLIDES:
        agree(got, expected, ("slip_x", "slip_y"), slice(PULL, None))


def pulled_and_turned(four, turn):
    """A patch that moves on under its pull, and turns by a torque of a share of that size."""
    both_of = four[:, SLIDES].copy()
    both_of[..., :2] += turn * four[:, TURNS, ..., :2]
    return both_of


def test_a_pivot_and_its_centre_are_what_numpy_says(engine, run, four):
    """Of two turns, the centre of the first is too far away to be told."""
    frames = np.stack([pulled_and_turned(four, turn) for turn in (0.2, -1.0)], axis=1)
    settings = replace(SETTINGS, axes=False, level=0.2)
    got = run(engine, both({"slip": 11.6, "twist": 0.3}, **asdict(settings)), frames)
    flags = ("slip_pivots", "slip_sense", "slip_centred")
    for n, sense in enumerate((1.0, -1.0)):
        expected = played(frames[:, n], settings)
        assert set(expected["slip_sense"]) == {0.0, sense}
        assert expected["slip_pivots"].any()
        assert expected["slip_centred"].any() == (sense < 0.0)
        own = {name: values[:, n] for name, values in got.items()}
        agree(own, expected, (*flags, "slip_torque", "slip_turning"))
        agree(own, expected, ("slip_row", "slip_column"), slice(PULL + 5, None))


def test_no_twist_is_reported_where_a_load_is_hidden(fast, run, four):
    """A patch turns under a slight pull; from a start without contact on, that is a twist."""
    frames = four[:, TURNS].copy()
    frames[..., :2] += 0.1 * four[:, SLIDES, ..., :2]
    held = np.concatenate([frames[PULL - 20 : PULL]] * 2 + [frames[PULL - 20 :]])
    seen = run(fast, both(**BOUND), frames)["twist"]
    hidden = run(fast, both(**BOUND), held)["twist"]
    assert seen[GO:].all()
    assert not hidden.any()
    assert not played(held, SETTINGS)["twist"].any()


@pytest.mark.parametrize("frames", [1, 3])
def test_a_reading_that_jumps_before_the_touch_hides_no_twist(fast, run, four, frames):
    """It is beyond any friction for as long, and as smoothed for 0.02 s; that is no held object."""
    jumps = four[:, TURNS].copy()
    at = SETTINGS.quiet + 5
    assert at + frames < PULL
    jumps[at : at + frames, 2, 3, 0] += 3.0 * np.abs(jumps).max()
    got, expected = run(fast, both(**BOUND), jumps), played(jumps, SETTINGS)
    assert got["twist"][GO:].all()
    agree(got, expected, ("twist", "twist_sense", "twist_strength"))


def test_under_a_faint_load_a_short_shear_beyond_friction_silences_twist(numba, run, four):
    """A held object shows it only now and then; without it the turn is reported."""
    settings = replace(SETTINGS, floor=240.0 * 200.0)  # three times the load of the patch
    frames = four[:, TURNS].copy()
    beyond = frames.copy()
    beyond[SETTINGS.quiet + 5, :, :, 0] += 0.5 * np.abs(frames).max()
    for stream, expected in ((frames, True), (beyond, False)):
        got, said = run(numba, both(**asdict(settings)), stream), played(stream, settings)
        assert got["twist"].any() == expected
        agree(got, said, ("twist", "twist_sense", "twist_strength"))


@pytest.mark.parametrize(("arm", "pivots"), [(-0.75, True), (12.0, False)])
def test_bristles_that_turn_about_a_place_pivot_and_far_ones_slide(run, numba, arm, pivots):
    trial = bristles.scene(bristles.swung(arm))(Arrays(), "swung", 7)
    got = run(numba, slip.bind(rate=trial.rate), trial.frames)
    at = int(np.argmax(trial.scored & (got["gross_slip"] > 0)))
    assert got["gross_slip"][at] > 0
    assert bool(got["slip_pivots"][at]) == pivots
    assert bool(got["slip_centred"][at]) == pivots
    if pivots:
        brush = bristles.Brush.drawn("swung", 7)
        column, row = brush.place_of(arm) / bristles.PITCH + 3.5
        assert got["slip_sense"][at] == np.sign(arm)
        # Coulomb's friction does not grow with the way from the place, as the program supposes:
        # that puts it at 0.75 (near) to 2 times (far) its true distance from the middle
        away = np.hypot(got["slip_row"][at] - row, got["slip_column"][at] - column)
        assert away < abs(arm) * brush.contact / bristles.PITCH


@pytest.mark.parametrize("axes", [True, False])
def test_two_pads_are_what_numpy_says(fast, run, four, axes):
    frames = np.concatenate([four[:, SLIDES], 0.7 * four[:, SLIDES, ::-1]], axis=-2)
    settings = replace(SETTINGS, pads=2, axes=axes, level=0.2, turn=0.02)
    rates = {"slip": 11.6, "twist": 0.7}
    got = run(fast, both(rates, **asdict(settings)), frames)
    expected = played(frames, settings)
    agree(got, expected, ("gross_slip", "slip_strength", "twist", "twist_strength"))
    agree(got, expected, ("slip_x", "slip_y"), slice(PULL + 5, None))
    assert expected["gross_slip"].any()


def test_parameters_are_those_of_the_definition(fast, run, four):
    frames = four[:, SLIDES]
    plain = run(fast, both(), frames)
    agree(plain, played(frames, Constants()), ("slip_strength", "twist_strength"))


def test_noise_slides_and_turns(fast, run, four):
    got = run(fast, both(**BOUND), four)
    slips, twists = got["gross_slip"] > 0, got["twist"] > 0
    assert not slips[:, [NOISE, TURNS, BACK]].any()
    assert not twists[:, [NOISE, SLIDES]].any()
    assert slips[-1, SLIDES]
    assert not slips[:GO, SLIDES].any()  # a pull that sticks is none
    assert twists[-1, [TURNS, BACK]].all()
    assert got["twist_sense"][-1].tolist() == [0.0, 0.0, 1.0, -1.0]


@pytest.mark.parametrize(
    ("frequency", "seed"),
    # the first was reported eight times while nothing remembered how the load swings
    [(3.0, 5_000_012), (0.5, 610_000)],
)
def test_touches_that_come_with_their_shear_are_no_slips(run, numba, frequency, seed):
    trial = oblique(frequency)(Arrays(), f"oblique touch, {frequency:g} Hz: spheres", seed)
    got = run(numba, slip.bind(rate=trial.rate), trial.frames, ["gross_slip"])
    assert not got["gross_slip"][trial.scored].any()


def test_a_turn_shows_in_the_shear_alone(numba):
    """Of bristles, whose shear all comes from the turn: it is the load and changes with it."""
    trial = bristles.scene(bristles.pivot)(Arrays(), "turn", 3)
    outputs = ("twist", "twist_sense")
    (said,) = side_by_side(numba, twist, outputs, [trial], channels=("shear_x", "shear_y"))
    turning = trial.sense != 0
    assert said["twist"][turning].any()
    before = np.arange(len(turning)) < np.argmax(turning) - trial.rate / 2.0
    assert not said["twist"][before & trial.scored].any()
    assert set(said["twist_sense"][said["twist"] > 0]) == {trial.sense[turning][0]}


def test_a_slip_under_one_of_two_pads_is_as_strong(fast, run, four):
    """The other pad has noise alone."""
    alone = run(fast, slip.bind(**BOUND), four[:, SLIDES], ["slip_strength"])["slip_strength"]
    both_pads = np.concatenate([four[:, NOISE], four[:, SLIDES]], axis=-2)
    wide = slip.bind(**BOUND, pads=2)
    beside = run(fast, wide, both_pads, ["slip_strength"])["slip_strength"]
    assert beside[GO + 10 :].max() > 0.9 * alone[GO + 10 :].max() > 0.0


def test_direction_is_that_of_the_slide(fast, run):
    for angle in (-2.0, 0.3, 1.5):
        frames = patch(np.random.default_rng(2), (8, 8), angle, 0.0)
        got = run(fast, both(**BOUND), frames)
        # noise of 1e-4 over the sum of a patch
        assert np.arctan2(got["slip_y"][-1], got["slip_x"][-1]) == pytest.approx(angle, abs=5e-3)


def test_gain_and_offset_do_not_matter(fast, run, four):
    program = both(**BOUND)
    one = run(fast, program, four[:, SLIDES])["slip_strength"]
    other = run(fast, program, 1e3 * four[:, SLIDES] + 500.0)["slip_strength"]
    # offsets of 500 round in single precision by 3e-5, the noise is 0.1
    np.testing.assert_allclose(other, one, rtol=5e-3, atol=1e-3)


def test_times_are_seconds(fast, run, four):
    """The same motion with every second frame left out is reported at the same time."""
    frames = four[:, SLIDES]
    whole = run(fast, both(rate=100.0), frames)["gross_slip"]
    half = run(fast, both(rate=50.0), frames[::2])["gross_slip"]
    assert np.argmax(whole > 0) / 100.0 == pytest.approx(np.argmax(half > 0) / 50.0, abs=0.03)


def test_diffusion_ends_in_the_mean():
    """The local mean of the definition, by the series of its modes, keeps the sum and evens out."""
    values = np.random.default_rng(1).normal(size=(4, 7))
    assert diffused(values, 3.0).sum() == pytest.approx(values.sum())
    np.testing.assert_allclose(diffused(values, 1e3), values.mean(), atol=1e-12)
    np.testing.assert_allclose(diffused(values, 0.0), values, atol=1e-12)


@pytest.mark.parametrize("cells", [(4, 4), (8, 8), (16, 16)])
def test_the_wave_of_loose_cells_ends_alike_by_steps_and_by_the_usual_method(fast, cells):
    """Both end where SciPy's propagation does, cell by cell, and at rest."""
    rng, maps = np.random.default_rng(3), 2000
    may = rng.random((maps, *cells)) < rng.uniform(0.2, 0.9, (maps, 1, 1))
    begins = may & (rng.random((maps, *cells)) < rng.uniform(0.0, 0.2, (maps, 1, 1)))
    eight = np.ones((3, 3), dtype=bool)
    expected = [binary_propagation(*each) for each in zip(begins, [eight] * maps, may, strict=True)]
    pictures = {"input": np.where(may, 1.0, -1.0), "state": np.where(begins, 1.0, -1.0)}
    for method in ("auto", WAVE.method):
        result = fast.run(get_template("RECALL"), **pictures, method=method)
        assert np.all(result.settled)
        np.testing.assert_array_equal(result.output, np.where(expected, 1.0, -1.0), method)


def test_columns_that_pads_cannot_share(fast, run):
    with pytest.raises(ProgramError, match="4×7 cells does not divide into 1×2 equal blocks"):
        run(fast, both(pads=2), np.zeros((1, 4, 7, 3)))


def auc(scores, labels):
    order = np.argsort(scores)
    ranks = np.empty(len(scores))
    ranks[order] = np.arange(1, len(scores) + 1)
    positive = labels.sum()
    above = ranks[labels].sum() - positive * (positive + 1) / 2
    return above / (positive * (len(labels) - positive))


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="no recordings; set CNNUM_RECORDINGS")
def test_recorded_grasps(fast, run):
    scores, labels, reports = [], [], {}
    for trial, wanted in TRIALS.items():
        with UskinCsvOptions(path=RECORDINGS / trial).open() as driver:
            rows = [(k, frame) for k, frame in enumerate(driver.frames()) if not frame.repeated]
        frames = [frame for _, frame in rows]
        values = np.stack([frame.values for frame in frames])
        got = run(fast, both(**USKIN), values, ["gross_slip", "slip_strength", "twist"])
        kept = np.logical_and.accumulate([not frame.truth["fail"] for frame in frames])
        assert not got["twist"][kept].any()
        begins = np.flatnonzero(np.diff(got["gross_slip"], prepend=0.0) > 0)
        reports[trial] = [rows[k][0] for k in begins if kept[k]]
        scores.append(got["slip_strength"][kept])
        labels.append(np.array([frame.truth["slip"] > 0 for frame in frames])[kept])
        assert all(min(abs(row - f) for f in reports[trial]) <= 2 for row in wanted), reports
    # with the frames' own time stamps in place of one rate it is 0.968
    assert auc(np.concatenate(scores), np.concatenate(labels)) >= 0.965
    # the level stands for simulated arrays: one trial without slip has two short reports
    assert not reports["02-21-14-10-49"]
    assert len(reports["02-21-17-22-56"]) <= 2


@program
def start(frame):
    """The fields that slip and twist start from."""
    recent = frame.once(
        RecentLoads, push=-1.0, shear_gain=1.0, pads=1, rest=0.4, look=0.08, floor=240.0
    )
    return {"load": recent.load}


def test_programs_inside_another_share_what_they_start_from():
    alone = sum(len(part.trace((4, 4)).memories) for part in (slip, twist))
    assert len(both().trace((4, 4)).memories) == alone - len(start.trace((4, 4)).memories)


def test_a_curl_below_the_shear_is_no_twist(fast, run, four):
    """However low the threshold: a slide has some curl, far below its shear."""
    got = run(fast, both(**BOUND, turn=1e-4), four)
    assert got["twist_strength"][PULL:, SLIDES].max() > 2e-4
    assert not got["twist"][:, SLIDES].any()


def test_a_turn_that_begins_as_a_press_ends_loses_little_of_its_curl(numba, monkeypatch):
    """Bristles that stick are pressed for 0.4 s and turned by 0.2 rad in 0.25 s: curl is angle.

    The load, smoothed over 0.02 s, grows by 2.5/s at the end of the press, and by less than 0.25/s
    from 0.02 s · ln 10 later on: what is taken off is the angle until then.
    """
    drawn = bristles.Brush.drawn("turned at once", 3)
    brush = replace(drawn, rate=100.0, flat=True, radius=2.4e-3, friction=5.0)
    monkeypatch.setattr(bristles.Brush, "drawn", lambda *_: brush)
    trials, begins = [], (90, 95, 140)
    for begin in begins:
        angle = np.concatenate([np.zeros(begin), np.linspace(0.0, 0.2, 25), np.full(70, 0.2)])
        depth = np.full(len(angle), brush.depth)
        depth[:50], depth[50:90] = -1e-6, brush.depth * np.linspace(0.025, 1.0, 40)
        way = bristles.Way.of(depth, angle=angle)
        trials.append(bristles.scene(lambda _, way=way: way)(Arrays(), "turned at once", 3))
    outputs = ("twist", "twist_sense", "twist_strength")
    *early, late = side_by_side(numba, twist, outputs, trials)
    whole = late["twist_strength"][-20:].mean()
    for got, begin, lost in zip(early, begins[:2], (0.02 * np.log(10.0) / 0.25, 0.0), strict=True):
        # 1 % of noise, and 0.01 s of a frame
        assert got["twist_strength"][-20:].mean() > (1.0 - lost - 0.01 - 0.04) * whole > 0.3
        assert set(got["twist_sense"][begin : begin + 90]) == {0.0, 1.0}
        assert got["twist"][begin + 12 :].all()
