"""Drivers without a fork: a module next to the scene, or an entry point of a package."""

import re
import sys
from pathlib import Path

import pytest

from cnnum.drivers import outside
from cnnum.drivers.registry import driver_names, open_driver
from cnnum.errors import CnnumError, SceneError

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "array.md"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the driver that the page shows."""
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (tmp_path / "my_pad.py").write_text(code)
    (tmp_path / "scene.toml").write_text(
        'wants = ["gross_slip"]\n[array]\ndriver = "my_pad:PadOptions"\nport = "none"\n'
        '[program]\nname = "slip"\n'
    )
    yield tmp_path
    sys.modules.pop("my_pad", None)


def test_a_module_beside_the_scene_is_its_driver(folder, call, records):
    result = call("run", folder / "scene.toml", "--engine", "numba", "--json")
    assert result.exit_code == 0, result.stderr
    assert records(result.stdout)[-1]["frames"] == 100


def test_its_options_are_checked_as_those_of_the_house(folder):
    with pytest.raises(SceneError, match=r"Driver 'my_pad:PadOptions': unknown option 'prt'"):
        open_driver("my_pad:PadOptions", {"prt": "x"}, base=folder)
    with pytest.raises(SceneError, match="'rate' must be a number, got 'fast'"):
        open_driver("my_pad:PadOptions", {"port": "x", "rate": "fast"}, base=folder)


def test_commands_take_it_as_a_source(folder, call, monkeypatch):
    monkeypatch.chdir(folder)
    result = call("record", "my_pad:PadOptions", "out.npz", "--set", "port=none")
    assert result.exit_code == 0, result.stderr
    assert "100 frames" in result.stdout


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("no_such_module:Options", "cannot be imported"),
        ("no.such.module:Options", "cannot be imported"),
        ("json:loads", "expected a dataclass 'loads'"),
        ("../evil:Options", "is no name of a module"),
        ("my_pd", "Unknown driver 'my_pd'"),
    ],
)
def test_what_is_no_driver_is_said(name, said, tmp_path):
    with pytest.raises(CnnumError, match=re.escape(said)):
        open_driver(name, {}, base=tmp_path)


def test_an_entry_point_is_a_name(folder, monkeypatch):
    point = outside.EntryPoint("my-pad", "my_pad:PadOptions", outside.GROUP)
    monkeypatch.setattr(outside, "entry_points", lambda group: [point])
    assert "my-pad" in driver_names()
    with open_driver("my-pad", {"port": "none"}, base=folder) as driver:
        assert driver.shape == (4, 4)
