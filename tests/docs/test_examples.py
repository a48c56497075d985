"""The examples run as they stand, and the pages of keys name every key."""

import re
import runpy
from dataclasses import fields
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import cnnum
from cnnum.drivers.own_data.layout import DataLayout
from cnnum.drivers.registry import DRIVERS
from cnnum.scenes import scene_file
from cnnum.scenes.events import EVENT_RULES
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.files import entry
from cnnum.templating.files.toml_format import _ABOUT, _DELAYED, _GAIN, _NONLINEAR, _READERS

DOCS = Path(__file__).parents[2] / "docs"
EXAMPLES = sorted((DOCS / "examples").glob("*.py"))


def a_session_finds_what_it_put_in(names, said):
    """The leak by its closed form, the 30 frames that are pressed, the scene's own onset."""
    found, exact = map(float, re.search(r"leak: (\S+), exact (\S+)", said).groups())
    assert found == pytest.approx(exact, abs=1e-5)
    assert "the same: True" in said
    assert "counted in a worker: 30" in said
    with cnnum.get_scene("contact") as scene:
        onset = next(frame.time for frame in scene.driver.frames() if frame.truth["contact"])
    time = float(re.search(r"first event: contact at (\S+) s", said)[1])
    # printed to 0.01 s; a load that begins as t^1.5 leaves the noise after 20 ms
    assert onset - 0.01 <= time <= onset + 0.04


def what_grows_is_the_solution_of_its_equation(names, said):
    """Black pixels at each time of its 81 coupled equations, with a white rim, by SciPy."""
    start = -np.ones((9, 9))
    start[4, 4] = 1.0

    def rates(_, x):
        x = x.reshape(9, 9)
        y = np.pad(np.clip(x, -1.0, 1.0), 1, constant_values=-1.0)
        near = y[:-2, 1:-1] + y[2:, 1:-1] + y[1:-1, :-2] + y[1:-1, 2:]
        return (-x + 2.0 * y[1:-1, 1:-1] + 0.5 * near + 2.7).ravel()

    way = solve_ivp(rates, (0.0, 4.0), start.ravel(), t_eval=[0, 1, 2, 4], rtol=1e-8, atol=1e-8)
    assert names["black"] == [int((x > 0).sum()) for x in way.y.T]


def a_program_costs_what_it_computes_and_hands_out(names, said):
    """A comparison and an "or" a cell; a flag of four bytes, and a map of 64 of them."""
    flops, out, left = zip(
        *re.findall(r"(\d+) flops, (\d+) bytes out, (\d+) left out", said), strict=True
    )
    assert (int(flops[0]), *map(int, out)) == (2 * 64, 4, 4 + 4 * 64)
    # EDGE has nine weights of its input at least, each a product and a sum
    assert int(flops[1]) >= 128 + 18 * 64
    assert int(left[0]) > int(left[1])


def a_corner_is_right_up_to_its_worst_case(names, said):
    """All weights off at once by less than that, either way: every answer of the examples stays."""
    template, bound = names["template"], float(re.search(r"less than (\S+) %", said)[1]) / 100
    rng = np.random.default_rng(7)
    signs = {part: rng.choice([-1.0, 1.0], (40, *getattr(template, part).shape)) for part in "ABz"}

    def wrong(off):
        parts = {part: getattr(template, part) * (1.0 + off * signs[part]) for part in "ABz"}
        batch = TemplateBatch(template, *(parts[p][:, None] for p in "AB"), parts["z"][:, None])
        found = names["engine"].run(batch, input=names["pictures"]).output > 0
        return (found != (names["answers"] > 0)).sum()

    # printed to a tenth of a per cent
    assert 0.0 < bound < 1.0
    assert wrong(bound - 0.0006) == 0
    assert wrong(3.0 * bound) > 0


HELD = {
    "whole_session": a_session_finds_what_it_put_in,
    "watch_a_template": what_grows_is_the_solution_of_its_equation,
    "cost_of_a_program": a_program_costs_what_it_computes_and_hands_out,
    "corner_from_examples": a_corner_is_right_up_to_its_worst_case,
}
"""The truth of what examples print, where they do not assert it themselves."""


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_finds_the_truth(path, capsys):
    names = runpy.run_path(str(path), run_name="__main__")
    said = capsys.readouterr().out
    assert said
    assert path.stem in HELD or "\nassert " in path.read_text()
    if path.stem in HELD:
        HELD[path.stem](names, said)


def test_every_example_is_on_the_page():
    page = (DOCS / "examples" / "README.md").read_text()
    assert len(EXAMPLES) >= 3
    assert all(path.name in page for path in EXAMPLES)


def test_every_key_of_a_scene_and_of_a_driver_is_on_its_page():
    page = (DOCS / "reference" / "scene-keys.md").read_text()
    assert all(f"`{table}." in page for table in scene_file._TABLES)
    for key in scene_file.KEYS:
        assert f"`calibration.{key}`" in page
    for name, place in DRIVERS.items():
        module, record = place.split(":")
        known = fields(getattr(import_module(module), record))
        row = next(line for line in page.splitlines() if line.startswith(f"| `{name}` |"))
        assert all(f"`{field.name}`" in row for field in known)


def test_every_key_of_a_template_and_of_a_layout_is_on_its_page():
    page = (DOCS / "reference" / "template-keys.md").read_text()
    couplings = (_NONLINEAR, _GAIN, _DELAYED)
    written = (entry.MEASURED_KEYS, entry.PROOF_KEYS, ("aliases", "measured", "proof"))
    keys = {key for table in (_READERS, _ABOUT, *couplings, *written) for key in table}
    assert len(keys) > 40
    assert {key for key in keys if f"`{key}`" not in page} == set()
    layout = (DOCS / "how-to" / "data.md").read_text()
    assert all(f"`{field.name}`" in layout for field in fields(DataLayout))


def test_every_event_is_on_its_page():
    page = (DOCS / "events.md").read_text()
    for rules in EVENT_RULES.values():
        assert all(f"`{rule.kind}`" in page for rule in rules)
