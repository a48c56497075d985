"""Orders and signs by a press: every wrong one is found, and none where they are right."""

import logging

import numpy as np
import pytest
from foreign_files import press

import cnnum
from cnnum.cli.commands.layout import drawn
from cnnum.cli.commands.probe import ProbeFigures
from cnnum.drivers import open_driver
from cnnum.frame import FORCE_AXES, Frame
from cnnum.recordings.checking import checked
from cnnum.scenes.push_watch import OrderWatch

WRONG = {
    "z, x, y": (lambda v: v[..., [2, 0, 1]], {"channels": ["z", "x", "y"]}),
    "z, y, x": (lambda v: v[..., ::-1], {"channels": ["z", "y", "x"]}),
    "y, x, z": (lambda v: v[..., [1, 0, 2]], {"channels": ["y", "x", "z"]}),
    "x turned": (lambda v: v * [-1, 1, 1], {"channels": ["-x", "y", "z"]}),
    "columns mirrored": (lambda v: v[:, :, ::-1], {"channels": ["-x", "y", "z"]}),
    "upside down": (lambda v: v[:, ::-1], {"channels": ["x", "-y", "z"]}),
    "both turned": (lambda v: v * [-1, -1, 1], {"channels": ["-x", "-y", "z"]}),
    "rows and columns swapped": (
        lambda v: v.transpose(0, 2, 1, 3).reshape(v.shape),
        {"order": "frames cols rows channels"},
    ),
    "axis-first as axis-last": (
        lambda v: v.transpose(0, 3, 1, 2).reshape(v.shape),
        {"order": "frames channels rows cols"},
    ),
    "Fortran's order": (
        lambda v: np.stack([one.ravel(order="F").reshape(one.shape) for one in v]),
        {"order": "frames channels cols rows"},
    ),
    "channels between": (
        lambda v: v.transpose(0, 1, 3, 2).reshape(v.shape),
        {"order": "frames rows channels cols"},
    ),
    "z turned": (lambda v: v * [1, 1, -1], {"channels": ["x", "y", "-z"]}),
    "z turned and named first": (
        lambda v: -v[..., [2]] * [1, 0, 0] + v[..., [0, 0, 1]] * [0, 1, 1],
        {"channels": ["-z", "x", "y"]},
    ),
}
SHAPES = [(8, 8), (4, 4), (6, 4), (5, 9)]


def orders(values, unit="count"):
    recording = cnnum.Recording(values, rate=100.0, unit=unit)
    (found,) = (one for one in checked(recording) if one.what == "order")
    return found


def watched(values, rate=100.0, unit="count"):
    watch = OrderWatch(FORCE_AXES)
    for n, frame in enumerate(values):
        watch.look(Frame(frame, FORCE_AXES, unit, n, n / rate))
    return watch.said


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", [0, 1])
def test_right_orders_are_called_right(shape, seed):
    values = press(*shape, seed=seed, offset=16_000)
    found = orders(values)
    assert not found.wrong
    assert "are right" in found.sentence
    assert not watched(values)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", WRONG)
def test_wrong_orders_are_named_with_their_cure(name, shape, caplog):
    turn, cure = WRONG[name]
    square = shape[0] == shape[1]
    if name == "rows and columns swapped" and square:  # the same as swapped shears
        cure = {"channels": ["y", "x", "z"]}
    values = np.ascontiguousarray(turn(press(*shape, offset=16_000)))
    found = orders(values)
    assert found.wrong
    assert found.cure == cure
    with caplog.at_level(logging.WARNING, "cnnum"):
        assert watched(values)
    assert len(caplog.messages) == 1


def test_strain_shows_the_same(tmp_path):
    script = [
        {"kind": "hold", "duration": 0.3},
        {"kind": "press", "duration": 0.3, "load": 0.5},
        {"kind": "hold", "duration": 0.3},
    ]
    with open_driver("simulated", {"script": script}) as array:
        values = np.stack([array.calibration.to_strain(f.values) for f in array.frames()])[::3]
    assert not orders(values, "strain").wrong
    assert not watched(values, array.rate / 3, "strain")
    assert orders(values * [-1, 1, 1], "strain").cure == {"channels": ["-x", "y", "z"]}


@pytest.mark.parametrize("seed", range(12))
def test_presses_of_other_shapes_on_uneven_arrays(seed):
    """Hertz's dome anywhere near the middle, a pull with it, taxels of their own rest and gain."""
    rng = np.random.default_rng(seed)
    rows, cols = [(4, 4), (16, 16), (6, 5), (3, 7)][seed % 4]
    y, x = np.mgrid[:rows, :cols] - np.array([rows - 1, cols - 1]).reshape(2, 1, 1) / 2
    y, x = y - rng.uniform(-0.1, 0.1) * rows, x - rng.uniform(-0.1, 0.1) * cols
    radius = rng.uniform(0.5, 0.7) * min(rows, cols)
    dome = np.sqrt(np.clip(1.0 - (x**2 + y**2) / radius**2, 0.0, None))
    load = np.stack([x / radius * dome, y / radius * dome, 2.0 * dome], axis=-1)
    load += rng.normal(0.0, 0.1, 3) * dome[..., np.newaxis]
    grown = np.clip((np.arange(150) - 60) / 30, 0.0, 1.0)[:, np.newaxis, np.newaxis, np.newaxis]
    values = 300.0 * grown * load * rng.normal(1.0, 0.1, load.shape) + rng.normal(
        0.0, 2.0, (150, *load.shape)
    )
    values += rng.uniform(15_000, 17_000, load.shape)
    assert "are right" in orders(values).sentence
    assert not watched(values)
    for name in ("Fortran's order", "z turned", "channels between", "axis-first as axis-last"):
        turn, cure = WRONG[name]
        wrong = np.ascontiguousarray(turn(values))
        assert orders(wrong).cure == cure
        assert watched(wrong)


def test_levels_at_rest_show_channels_that_are_mixed():
    """No press straight down is needed where each channel rests at a level of its own."""
    rng = np.random.default_rng(0)
    for rows, cols in ((4, 4), (6, 4)):
        values = rng.normal([16_000.0, 16_300.0, 38_000.0], 200.0, (rows, cols, 3))
        values = values + rng.normal(0.0, 2.0, (200, rows, cols, 3))
        values[100:] += (
            300.0 * np.exp(-0.3 * np.arange(rows)[:, None, None]) * np.array([1, 0.2, 1])
        )
        assert not orders(values).wrong
        for name in ("Fortran's order", "axis-first as axis-last"):
            turn, cure = WRONG[name]
            found = orders(np.ascontiguousarray(turn(values)))
            assert found.wrong
            assert (cure["order"] in found.sentence) or found.cure == cure
            if rows != cols:
                assert found.cure == cure
        assert not orders(values + rng.normal(0.0, 9_000.0, values.shape[1:])).wrong


@pytest.mark.parametrize("shape", [(6, 8), (12, 32), (8, 8)])
def test_one_channel_by_columns_is_found_or_asked_about(shape):
    """A load is compact in one order alone, unless the array is square."""

    def order(values):
        recording = cnnum.Recording(values, rate=100.0, channels=("normal",))
        (found,) = (one for one in checked(recording) if one.what == "order")
        return found

    values = press(*shape, axes=1, offset=30, size=150)
    turned = np.ascontiguousarray(values.swapaxes(1, 2)).reshape(values.shape)
    assert not order(values).wrong
    assert "press one corner" in order(values).sentence
    if shape[0] == shape[1]:
        assert order(turned) == order(values)
        assert "Nothing shows whether rows and columns are swapped" in order(values).sentence
    else:
        assert "Rows and columns are right" in order(values).sentence
        assert order(turned).cure == {"order": "frames cols rows channels"}
        assert "a press is smooth" in order(turned).sentence.lower()
    pulled = np.concatenate([values, values, values], axis=-1)[..., :2]
    two = cnnum.Recording(pulled, rate=100.0, channels=("shear_x", "shear_y"))
    assert not any(one.wrong for one in checked(two) if one.what == "order")


def test_a_twist_a_pull_and_noise_are_no_wrong_order():
    """The shear of a twist is across the places, that of a pull the same everywhere."""
    values = press(8, 8, offset=16_000)
    rest = 16_000.0
    away = values - rest
    twist = np.stack([-away[..., 1], away[..., 0], away[..., 2]], axis=-1)
    pull = np.stack([away[..., 2], -0.5 * away[..., 2], away[..., 2]], axis=-1)
    flat = np.random.default_rng(0).normal(0.0, 2.0, values.shape)
    load = np.concatenate([flat[..., :2], away[..., 2:]], axis=-1)
    for moved in (twist, pull, flat, load):
        assert not orders(rest + moved).wrong
        assert not watched(rest + moved)


def test_dead_stuck_and_noisy_taxels_and_touched_ones():
    values = press(8, 8, offset=16_000, size=20_000)
    values[:, 2, 3], values[:, 0, 0] = 0.0, 17.0
    values[:, 7, 7] += np.random.default_rng(1).normal(0.0, 40.0, (len(values), 3))
    found = {one.what: one for one in checked(cnnum.Recording(values, rate=100.0)) if one.wrong}
    assert found["dead"].cure == {"frames.dead": [[2, 3]]}
    assert found["stuck"].cure == {"frames.dead": [[0, 0]]}
    assert found["noisy"].cure == {"frames.dead": [[7, 7]]}


def test_taxels_without_numbers_are_dead_and_the_others_are_looked_at():
    """One column of NaN made all frames bad, and nothing else was said."""
    values = press(8, 8, offset=16_000)
    values[:, 2, 3, 1] = np.nan
    found = {one.what: one for one in checked(cnnum.Recording(values, rate=100.0))}
    assert found["dead"].cure == {"frames.dead": [[2, 3]]}
    assert "no number at all" in found["dead"].sentence
    assert "are right" in found["order"].sentence
    assert "bad" not in found


def test_a_probe_calls_no_touched_cell_noisy():
    values = press(8, 8, offset=16_000, size=20_000)
    values[:, 7, 7] += np.random.default_rng(1).normal(0.0, 40.0, (len(values), 3))
    figures = ProbeFigures()
    for n, frame in enumerate(values):
        figures.add(Frame(frame, FORCE_AXES, "count", n, n / 100.0))
    assert {cell[:2] for cell in figures.noisy} == {(7, 7)}
    # the touched ones moved much further
    assert figures.deviation[4, 3, 2] > 5.0 * figures.deviation[7, 7, 2]


FACTS = {
    "unit": ({"rate": 100.0, "unit": "strain"}, "no cover is strained so far"),
}


@pytest.mark.parametrize("what", FACTS)
def test_a_rate_and_a_unit_that_cannot_be(what):
    parts, said = FACTS[what]
    recording = cnnum.Recording(press(4, 4), **parts)
    (found,) = (one for one in checked(recording) if one.what == what)
    assert found.wrong
    assert said in found.sentence


def test_a_channel_without_a_number_is_named():
    values = press(4, 4, offset=900)
    values[..., 1] = np.nan
    faults = [one.sentence for one in checked(cnnum.Recording(values, rate=100.0)) if one.wrong]
    assert any("'shear_y' has no number at all" in said for said in faults), faults
    assert not any("'normal'" in said for said in faults)


def test_a_frame_with_a_number_that_is_cut_hides_no_press():
    """16,002 that ends as 160 was the largest load, beside which nothing was a press."""
    values = press(4, 4, offset=16_000)
    values[-1, 3, 3, 2] = 160.0
    (order,) = (one for one in checked(cnnum.Recording(values, rate=100.0)) if one.what == "order")
    assert "orders and signs are right" in order.sentence


def test_counts_that_run_over():
    values = np.rint(press(8, 8, offset=40, size=260, noise=1.0)) % 256
    assert "wrap" in {one.what for one in checked(cnnum.Recording(values, rate=100.0)) if one.wrong}
    signed = (np.rint(press(8, 8, offset=0, size=200, noise=1.0)) + 128) % 256 - 128
    (found,) = (one for one in checked(cnnum.Recording(signed, rate=100.0)) if one.what == "wrap")
    assert "-128 to 127" in found.sentence
    pulled = np.clip(np.rint(press(8, 8, offset=0, size=-100, noise=1.0)), -128, 127)
    assert "wrap" not in {one.what for one in checked(cnnum.Recording(pulled, rate=100.0))}
    below = np.clip(np.rint(press(8, 8, offset=40, size=260, noise=1.0)), 0, 255)
    assert "wrap" not in {one.what for one in checked(cnnum.Recording(below, rate=100.0))}


def test_the_picture_has_two_letters_a_taxel():
    assert drawn(np.array([[0.0, 1.0], [0.5, -1.0]])) == "+----+\n|  @@|\n|==@@|\n+----+"
