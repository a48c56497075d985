"""The examples run as they stand, and the pages of keys name every key."""

import re
import runpy
from dataclasses import fields
from importlib import import_module
from pathlib import Path

import pytest

import cnnum
from cnnum.drivers.own_data.layout import DataLayout
from cnnum.drivers.registry import DRIVERS
from cnnum.scenes import scene_file
from cnnum.scenes.events import EVENT_RULES
from cnnum.templating.files import entry
from cnnum.templating.files.toml_format import _ABOUT, _DELAYED, _GAIN, _NONLINEAR, _READERS

DOCS = Path(__file__).parents[2] / "docs"
EXAMPLES = sorted((DOCS / "examples").glob("*.py"))


def a_session_finds_what_it_put_in(said):
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


HELD = {"whole_session": a_session_finds_what_it_put_in}
"""The truth of examples that do not assert it themselves."""


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_finds_the_truth(path, capsys):
    runpy.run_path(str(path), run_name="__main__")
    said = capsys.readouterr().out
    assert said
    assert path.stem in HELD or "\nassert " in path.read_text()
    if path.stem in HELD:
        HELD[path.stem](said)


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
