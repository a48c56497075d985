"""Every scene that comes with the package reports, and what it reports is its array's own truth."""

import numpy as np
import pytest

from cnnum.drivers.simulated.cover import CELLS, MARGIN
from cnnum.errors import PhysicsError
from cnnum.scenes.pipeline import load_scene


def played(name, **changes):
    """Return a scene, its moments and the truth of each."""
    scene = load_scene(name, changes=changes)
    moments = [moment for moment in scene.results() if moment.outputs]
    return scene, moments, [moment.frame.truth for moment in moments]


def loads_on_bumps(array):
    """Return the force on every bump at every scan, (scans, rows, cols, 3) N, x, y and normal."""
    rows, cols = (n + 2 * MARGIN for n in array.shape)
    found = []
    for state, _ in array.scans():
        whole = np.zeros((*array.surface.shape, 3))
        if state.load > 0:
            window = array._tractions.window([state])
            whole[window.rows, window.cols] = array._tractions([state], window)[0]
        squares = whole.reshape(rows, CELLS, cols, CELLS, 3).sum(axis=(1, 3))
        found.append(array.surface.cell_area * squares[MARGIN:-MARGIN, MARGIN:-MARGIN])
    return np.array(found)


def test_localize_gives_the_load_on_every_bump():
    """In newtons, with the sign of the pull, at rest and while it slides."""
    scene, moments, truths = played("localize")
    own = loads_on_bumps(scene.driver)
    held = [n for n, truth in enumerate(truths) if truth["normal_force"] > 0.05]
    assert len(held) > 400
    for n in held[::10]:
        out, top = moments[n].outputs, own[n, ..., 2].max()
        touched = out["bump_contact"] > 0
        # a bump counts from a tenth of the largest load on; noise is 1 % of that
        assert touched[own[n, ..., 2] > 0.12 * top].all()
        assert not touched[own[n, ..., 2] < 0.08 * top].any()
        for k, axis in enumerate(("x", "y", "normal")):
            off = np.abs(out[f"bump_load_{axis}"] - own[n, ..., k])[touched].max()
            # noise of 2.5 mV is 3.5e-4 of strain: 0.1 mN of normal load, 0.3 mN of shear, of 20 mN
            assert off < (0.01 if axis == "normal" else 0.08) * top
        pull = np.array([truths[n]["shear_x"], truths[n]["shear_y"]]) / truths[n]["normal_force"]
        found = np.array([out[f"bump_load_{axis}"].sum() for axis in "xy"])
        assert np.abs(found / out["bump_load_normal"].sum() - pull).max() < 0.02
    events = [event for moment in moments for event in moment.events]
    assert [event.kind for event in events] == ["bump", "bump_release"]
    touching = [n for n, truth in enumerate(truths) if truth["contact"]]
    # load begins as t^1.5: 6 standard deviations of the noise are reached in 20 ms
    assert 0 <= events[0].t - moments[touching[0]].frame.time < 0.03
    assert abs(events[1].t - moments[touching[-1]].frame.time) < 0.03
    assert events[0].unit == "N"
    first = moments[events[0].frame].outputs
    assert events[0].where == (float(first["bump_row"]), float(first["bump_column"]))
    # the sphere comes down at (−0.9, −0.4) mm: row 3.2, column 2.9, and one bump is touched first
    assert np.abs(np.array(events[0].where) - [3.5 - 0.4 / 1.5, 3.5 - 0.9 / 1.5]).max() < 0.6


def test_bumps_too_close_to_be_told_apart_are_refused():
    with pytest.raises(PhysicsError, match=r"Bumps 2\.5 radii apart over taxels 1\.66667 radii"):
        load_scene("localize", changes={"array.bump_radius": 0.6e-3, "array.thickness": 1e-3})


def test_a_flat_cover_has_no_bumps_to_report(caplog):
    """No event by "everything"; bumps that are asked for are doubted."""
    whole = load_scene("tactile")
    assert not [rule for rule in whole.rules if rule.kind == "bump"]
    assert not caplog.records
    load_scene("contact", changes={"wants": ["bump_count"]})
    assert "has no bumps" in caplog.text
    caplog.clear()
    load_scene("localize")
    assert not caplog.records


@pytest.mark.parametrize(("radius", "thickness"), [(0.2e-3, 0.3e-3), (0.15e-3, 0.15e-3)])
def test_another_cover_of_the_users_is_inverted_as_it_is(radius, thickness):
    """The geometry comes from the array: no parameter says it, by either program."""
    for program in ("localize", "tactile"):
        scene, moments, _ = played(
            "localize",
            **{
                "array.bump_radius": radius,
                "array.thickness": thickness,
                "array.noise": 0.0,
                "program.name": program,
                "array.script": [
                    {"kind": "hold", "duration": 0.2},
                    {"kind": "press", "duration": 0.2, "load": 0.03},
                    {"kind": "pull", "duration": 0.2, "speed": 0.4e-3, "direction": -2.0},
                ],
            },
        )
        own, out = loads_on_bumps(scene.driver)[-1], moments[-1].outputs
        touched = out["bump_contact"] > 0
        for k, axis in enumerate(("x", "y", "normal")):
            off = np.abs(out[f"bump_load_{axis}"] - own[..., k])[touched].max()
            # the inverse is cut at three bumps to each side: 2 %
            assert off < 0.02 * own[..., 2].max()
