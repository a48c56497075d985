"""Drivers without a fork: a module next to the scene, or an entry point of a package."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from cnnum import Recording, load_scene
from cnnum.drivers import registry
from cnnum.drivers.registry import driver_names, open_driver
from cnnum.errors import CnnumError, SceneError

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "array.md"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the driver that the page shows."""
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (tmp_path / "my_pad.py").write_text(code)
    (tmp_path / "scene.toml").write_text(
        'needs = ["gross_slip"]\n[array]\ndriver = "my_pad:PadOptions"\nport = "none"\n'
        '[program]\nname = "slip"\n'
    )
    yield tmp_path
    sys.modules.pop("my_pad", None)


def test_a_module_beside_the_scene_is_its_driver(folder, call, records):
    result = call("run", folder / "scene.toml", "--trust", "--engine", "numba", "--json")
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
        ("../evil:Options", "is not a valid module name"),
        ("my_pd", "Unknown driver 'my_pd'"),
    ],
)
def test_what_is_no_driver_is_said(name, said, tmp_path):
    with pytest.raises(CnnumError, match=re.escape(said)):
        open_driver(name, {}, base=tmp_path)


def test_an_entry_point_is_a_name(folder, monkeypatch):
    point = registry.EntryPoint("my-pad", "my_pad:PadOptions", registry.GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda group: [point])
    monkeypatch.syspath_prepend(folder)  # it is installed
    assert "my-pad" in driver_names()
    with open_driver("my-pad", {"port": "none"}, base=folder) as driver:
        assert driver.shape == (4, 4)


EVIL = "from pathlib import Path\nPath(__file__).with_name('ran').touch()\n"
SCENE = """
needs = ["gross_slip"]
[array]
driver = "{}"
[program]
name = "slip"
[engine]
name = "numba"
"""
RANGES = 'precision = "q15"\n[engine.ranges]\ndriver = "{}"\n'
COMMANDS = {
    "plan": ("SCENE",),
    "run": ("SCENE",),
    "run --trace": ("run", "SCENE", "--trace", "trace.html"),
    "run --set": ("run", "SCENE", "--set", "array.driver=simulated", "--frames", 3),
    # a value of another key may be the name of a file that came with the scene
    "plan --set": ("plan", "SCENE", "--set", "engine.device=evil:Options"),
    "view": ("SCENE", "--port", 0),
    "record": ("SCENE", "tape.npz"),
    "probe": ("SCENE",),
    "simulate": ("SCENE", "--pty", "--seconds", 0.1),
    "replay": ("tape.mcap", "--scene", "SCENE"),
}
NAMES = ("evil:Options", "evil.inner:Options", "inner.evil:Options", "this:x", "evil:Options:x")


CASES = [*((NAMES[0], command) for command in COMMANDS), *((name, "plan") for name in NAMES[1:])]


@pytest.mark.promise("No scene file runs code, in any command that opens one, unless one says so.")
@pytest.mark.parametrize(("name", "command"), CASES)
@pytest.mark.parametrize("place", ["array", "ranges"])
def test_no_scene_runs_code_unasked(command, name, place, tmp_path, call, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for file in ("evil.py", "evil/inner.py", "inner/evil.py", "simulated.py"):
        Path(file).parent.mkdir(exist_ok=True)
        Path(file).write_text(EVIL)
    known = set(sys.modules)
    driver = name if place == "array" else "simulated"
    text = SCENE.format(driver) + (RANGES.format(name) if place == "ranges" else "")
    Path("scene.toml").write_text(text)
    Recording(np.zeros((3, 8, 8, 3)), rate=60.0).save("tape.mcap")
    words = COMMANDS[command]
    words = words if words[0] == command.split()[0] else (command, *words)
    result = call(*("scene.toml" if word == "SCENE" else word for word in words))
    assert not list(tmp_path.rglob("ran"))
    new = set(sys.modules) - known
    assert not {module for module in new if "evil" in module or module == "this"}
    replaced = place == "array" and command in ("run --set", "replay")  # by the user's own array
    assert result.exit_code == (0 if replaced else 2)
    assert replaced or "is code that would run" in result.stderr


def test_a_name_that_the_user_gives_is_trusted(folder, call):
    named = ("--set", "array.driver=my_pad:PadOptions", "--frames", 3)
    assert call("run", folder / "scene.toml", "--engine", "numba", *named).exit_code == 0
    with pytest.raises(SceneError, match="give --trust"):
        load_scene(folder / "scene.toml")
    with load_scene(folder / "scene.toml", trust=True).driver as driver:
        assert driver.shape == (4, 4)


@pytest.mark.promise("No scene file runs code, in any command that opens one, unless one says so.")
def test_an_entry_point_is_never_looked_for_beside_a_scene(folder, monkeypatch):
    point = registry.EntryPoint("my-pad", "my_pad:PadOptions", registry.GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda group: [point])
    with pytest.raises(SceneError, match="reinstall it"):
        open_driver("my-pad", {"port": "none"}, base=folder)
