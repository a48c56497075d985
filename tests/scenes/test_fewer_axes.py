"""Arrays that read one axis or two: what they give, and what is said of the rest."""

import numpy as np
import pytest

import cnnum
from cnnum.cli import main
from cnnum.drivers.simulated.array import SimulatedOptions
from cnnum.drivers.simulated.settings import Phase
from cnnum.errors import SceneError
from cnnum.programs.library import get_program
from cnnum.scenes.arrangement import given_by
from cnnum.scenes.pipeline import load_scene

NUMBA = cnnum.Engine("numba")
AXES = ("shear_x", "shear_y", "normal")
SCRIPT = (
    Phase("hold", 0.5),
    Phase("press", 0.4, load=1.0),
    Phase("hold", 0.5),
    Phase("pull", 1.2, speed=1.5e-3, direction=0.5),
    Phase("release", 0.3),
    Phase("hold", 0.3),
)


@pytest.fixture(scope="module")
def strain():
    with SimulatedOptions(script=SCRIPT, rate=100.0, seed=3).open() as array:
        frames = list(array.frames())
        values = array.calibration.to_strain(np.stack([frame.values for frame in frames]))
    return values, np.array([frame.truth["slip"] for frame in frames])


def scene(values, channels, needs, program="tactile", **parameters):
    kept = values[..., [AXES.index(name) for name in channels]]
    recording = cnnum.Recording(kept, rate=100.0, unit="strain", channels=channels)
    changes = {"needs": needs, "program.name": program, "program.parameters": parameters}
    return load_scene("contact", recording=recording, changes=changes, engine=NUMBA)


def events(values, channels, needs, **more):
    with scene(values, channels, needs, **more) as opened:
        return [(event.kind, event.time) for event in opened.events()]


def test_an_array_without_shear_has_contacts_edges_bumps_and_loads(strain):
    values, _ = strain
    needs = ["contact", "contact_area", "load_normal"]
    with scene(values, AXES, needs, "contact", depth=0.667) as whole:
        three = whole.collect()
    with scene(values, ("normal",), needs, "contact", depth=0.667) as opened:
        one = opened.collect()
    kinds = [[event.kind for event in each.events] for each in (three, one)]
    assert kinds[0] == kinds[1] == ["contact", "release"]
    held = slice(100, 130)  # nothing pulls: the load is the same, but for what shear tells of it
    loads = [each["load_normal"][held].mean() for each in (three, one)]
    assert loads[1] == pytest.approx(loads[0], rel=0.03)
    assert abs(three["contact_area"][held] - one["contact_area"][held]).max() <= 2


def test_an_array_without_a_load_reports_slips(strain):
    values, slips = strain
    found = [
        time for kind, time in events(values, AXES[:2], ["slip"], program="slip") if kind == "slip"
    ]
    begin = np.flatnonzero(slips)[0] / 100.0
    assert len(found) >= 1
    assert begin - 0.1 <= found[0] <= begin + 0.3


@pytest.mark.parametrize(
    ("channels", "needs", "program", "words"),
    [
        (("normal",), ["slip"], "slip", "'shear_x' and 'shear_y', which the array does not read"),
        (("normal",), ["twist"], "tactile", "'twist' of the program 'tactile' needs 'shear_x'"),
        (("normal",), ["friction_used"], "contact", "'friction_used' of the program 'contact'"),
        (AXES[:2], ["contact"], "contact", "'normal', which the array does not read"),
        (AXES[:2], ["contact"], "tactile", "'contact' of the program 'tactile' needs 'normal'"),
    ],
)
def test_what_an_array_cannot_give_is_said(strain, channels, needs, program, words):
    with pytest.raises(SceneError, match=words):
        scene(strain[0], channels, needs, program)


def test_a_typing_error_is_no_missing_axis(strain):
    with pytest.raises(cnnum.CnnumError, match="did you mean 'contact_area'"):
        scene(strain[0], ("normal",), ["contact_aria"])


def test_each_event_is_given_or_its_missing_axes_are_named():
    found = given_by((4, 4), AXES[:2])
    assert {given.event for given in found if given.programs} == {"slip", "twist"}
    assert all(given.missing == (() if given.programs else ("normal",)) for given in found)
    events = {given.event for given in found}
    assert {"contact", "edge", "bump", "texture", "grasp", "outline", "flow"} <= events


def test_plan_lists_what_an_array_cannot_give(strain, tmp_path, capsys):
    cnnum.Recording(strain[0][..., 2:], rate=100.0, unit="strain", channels=("normal",)).save(
        tmp_path / "mat.npz"
    )
    file = f"array.path={tmp_path / 'mat.npz'}"
    how = ["plan", "contact", "--set", "array.driver=npz", "--set", file]
    with pytest.raises(SystemExit, match="0"):
        main([*how, "--set", "program.name=contact", "--engine", "numba"])
    text = capsys.readouterr().out
    cannot = {line.split()[2] for line in text.splitlines() if "cannot give" in line}
    can = {line.split()[2] for line in text.splitlines() if " can give" in line}
    assert {"slip", "twist", "grasp", "texture"} <= cannot
    assert {"contact", "edge", "bump", "outline", "onset", "flow", "drift"} <= can
    assert "reads no shear_x and no shear_y" in text


def test_taxels_that_carry_their_own_load_have_edges():
    rows, cols = np.mgrid[:12, :12]
    flat = 1.0 * ((abs(rows - 5.5) < 3.0) & (abs(cols - 5.5) < 3.0))
    frames = np.random.default_rng(1).normal(0.0, 1e-3, (60, 12, 12, 1))
    frames[30:] += flat[..., None]
    program = get_program("edges").bind(push=1.0, reads="force", rate=100.0)
    plan = NUMBA.compile(program, (12, 12), ["edges"], channels=("normal",))
    stream = plan.stream()
    edges = [stream.push(frame)["edges"] for frame in frames][-1] > 0.5
    inner = abs(rows - 5.5) < 2.0
    rim = (flat > 0.0) & ~(inner & (abs(cols - 5.5) < 2.0))
    assert (edges & rim).sum() >= 16
    assert not edges[abs(rows - 5.5) > 4.0].any()


def test_a_place_is_on_one_pad():
    rows, cols = np.mgrid[:4, :8]
    frames = np.random.default_rng(2).normal(0.0, 1e-3, (60, 4, 8, 3))
    both = np.exp(-((rows - 1.0) ** 2 + (cols - 1.0) ** 2)) + 0.6 * np.exp(
        -((rows - 2.0) ** 2 + (cols - 6.0) ** 2)
    )
    frames[30:, ..., 2] -= both
    for pads, column in ((2, 1.0), (1, None)):
        program = get_program("tactile").bind(pads=pads, reads="force", rate=100.0)
        plan = NUMBA.compile(program, (4, 8), ["contact_row", "contact_column"], channels=AXES)
        stream = plan.stream()
        last = [stream.push(frame[..., [AXES.index(n) for n in plan.schedule.channels]])
                for frame in frames][-1]  # fmt: skip
        if column is None:
            assert 2.0 < last["contact_column"] < 5.0
        else:
            assert last["contact_column"] == pytest.approx(column, abs=0.35)
