"""Options that make no sense: one sentence and exit code 2, in drivers, scenes and commands."""

import inspect
import os
import subprocess
import sys
import time
from dataclasses import fields
from importlib import import_module
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from cnnum.cli import main
from cnnum.cli.root import COMMANDS
from cnnum.drivers.registry import DRIVERS, open_driver
from cnnum.drivers.simulated.settings import Phase
from cnnum.errors import CnnumError
from cnnum.programs.library import get_program, program_names
from cnnum.scenes.scene_file import read_scene

SECONDS = 10  # on a busy machine; none takes one
VALUES = {
    "400 digits": 10**400,
    "minus 400 digits": -(10**400),
    "5000 digits": 10**5000,
    "NUL": "a\0b",
    "10¹²": 10**12,
    "negative": -1,
    "NaN": float("nan"),
    "infinity": float("inf"),
    "minus infinity": float("-inf"),
    "denormal": 5e-324,
    "largest": 1.7e308,
    "empty": "",
    "megabyte": "x" * 1_000_000,
    "list": [1, 2],
    "no list": [],
    "lists": [[[1]]],
    "table": {"a": 1},
    "true": True,
    "nobody's home": "~nobody-here/x",
    "surrogate": "\ud800",
}
NEEDED = {
    "simulated": {"shape": (2, 2)},
    "serial": {"port": "/dev/ttyNONE"},
    "uskin-csv": {"path": "none"},
    "mcap": {"path": "none.mcap"},
    "npz": {"path": "none.npz"},
    "file": {"path": "none.csv"},
}


def fault_of(call, *arguments, **options):
    """Return the fault in the way in which a call ends; None where there is none."""
    began = time.monotonic()
    try:
        call(*arguments, **options)
    except CnnumError as error:
        said = str(error)
        if "\n" in said or len(said) > 2000:
            return f"not one sentence: {said:.100}"
    except Exception as error:
        return f"{type(error).__name__}: {error!s:.100}"
    took = time.monotonic() - began
    return f"took {took:.1f} s" if took > SECONDS else None


def opened(name, options):
    with open_driver(name, options) as driver:
        next(iter(driver.frames()))


def traced(name, parameters):
    get_program(name).bind(**parameters).trace((8, 8))


def options_of(name):
    module, record = DRIVERS[name].split(":")
    return [field.name for field in fields(getattr(import_module(module), record))]


@pytest.mark.parametrize("name", DRIVERS)
def test_drivers(faults, name):
    """Every option of a driver is taken or refused in one sentence, at any value."""
    cases = [(key, value) for key in (*options_of(name), "zz") for value in VALUES]
    for key, value in faults.each(cases, short=40):
        if fault := fault_of(opened, name, {**NEEDED[name], key: VALUES[value]}):
            faults.lose(f"{key} = {value}: {fault}")


def test_phases(faults):
    """Every amount of a simulated phase is taken or refused in one sentence."""
    cases = [(field.name, value) for field in fields(Phase) for value in VALUES]
    press = {"kind": "press", "duration": 0.1, "load": 1.0}
    for key, value in faults.each(cases, short=40):
        script = [press, {"kind": "pull", "duration": 0.1, "speed": 1e-3, key: VALUES[value]}]
        if fault := fault_of(opened, "simulated", {"shape": (2, 2), "script": script}):
            faults.lose(f"{key} = {value}: {fault}")


def test_programs(faults):
    """Every parameter of a program is taken or refused in one sentence."""
    cases = [
        (name, key, value)
        for name in program_names()
        for key in (*inspect.signature(get_program(name).function).parameters, "zz")
        for value in VALUES
    ]
    for name, key, value in faults.each(cases, short=60):
        if fault := fault_of(traced, name, {key: VALUES[value]}):
            faults.lose(f"{name}: {key} = {value}: {fault}")


KEYS = (
    *("name", "needs", "array", "calibration", "program", "engine", "zz", "array.driver"),
    *("calibration.file", "calibration.use", "calibration.zz", "program.name"),
    *("program.parameters", "engine.name", "engine.device", "engine.precision", "array.seed.x"),
)
SCENE = 'needs = ["contact"]\n[array]\ndriver = "simulated"\nseed = 1\n'


def test_scenes(faults, tmp_path):
    """Every key of a scene is taken or refused in one sentence, before anything is opened."""
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    cases = [(key, value) for key in KEYS for value in VALUES]
    for key, value in faults.each(cases, short=60):
        if fault := fault_of(read_scene, path, changes={key: VALUES[value]}):
            faults.lose(f"{key} = {value}: {fault}")


ARGUMENTS = {
    "400 digits": "1" * 400,
    "5000 digits": "1" * 5000,
    "NUL": "a\0b",
    "negative": "-1",
    "NaN": "nan",
    "empty": "",
    "megabyte": "x" * 1_000_000,
    "list": "[1,2]",
    "brackets": "x=" + "[" * 5000,
    "table": "{a=1}",
    "dots": ".".join("a" * 5000) + "=1",
    "device": "/dev/zero",
    "surrogate": "\udcff",
    "digits in a key": "array.seed=" + "1" * 400,
}
# each ends soon, with any options: the engine or the scene that it names is not there
CALLS = {
    "demo": ["--set", "array.script=[]"],
    "run": ["nowhere"],
    "plan": ["nowhere"],
    "probe": ["nowhere"],
    "record": ["nowhere", "out.npz"],
    "replay": ["nowhere.npz"],
    "calibrate": ["nowhere.csv", "--youngs-modulus", "1e6"],
    "score": ["--engine", "nowhere"],
    "reproduce": ["nothing"],
    "templates show": ["NOTHING"],
    "templates check": ["NOTHING"],
}


def leaf(name):
    command = main
    for part in name.split():
        command = command.get_command(click.Context(command), part)
    return command


def test_commands(faults, tmp_path, monkeypatch):
    """Every option of a command gets one sentence and exit code 2 for values it cannot use."""
    monkeypatch.chdir(tmp_path)
    cases = [
        (name, option.opts[-1], what)
        for name in CALLS
        for option in leaf(name).params
        if isinstance(option, click.Option) and not option.is_flag
        for what in ARGUMENTS
    ]
    for name, option, what in faults.each(cases, short=60):
        arguments = [*name.split(), *CALLS[name], option, ARGUMENTS[what]]
        if fault := ends_badly(arguments):
            faults.lose(f"{name} {option} {what}: {fault}")


def test_arguments(faults, tmp_path, monkeypatch):
    """Every argument of a command gets one sentence and exit code 2 where it names nothing."""
    monkeypatch.chdir(tmp_path)
    cases = [(name, what) for name in CALLS for what in ARGUMENTS if name != "demo"]
    for name, what in faults.each(cases, short=60):
        _, *others = CALLS[name]
        if fault := ends_badly(
            [*name.split(), "--", ARGUMENTS[what]]
            if not others
            else [*name.split(), ARGUMENTS[what], *others]
        ):
            faults.lose(f"{name} {what}: {fault}")


def ends_badly(arguments):
    began = time.monotonic()
    result = CliRunner().invoke(main, arguments)
    took = time.monotonic() - began
    said = result.stderr
    if result.exit_code != 2 or not said.startswith("cnnum: ") or said.count("\n") != 1:
        return f"exit code {result.exit_code}, {said:.300}"
    return f"took {took:.1f} s" if took > SECONDS or len(said) > 2100 else None


def test_commands_as_processes(faults, tmp_path):
    """A command on a pipe, a device or a folder ends soon, with one sentence and exit code 2."""
    for name in ("pipe.toml", "pipe.npz", "pipe.csv"):
        os.mkfifo(tmp_path / name)
    (tmp_path / "folder.npz").mkdir()
    cases = [
        ["run", "pipe.toml"],
        ["replay", "pipe.npz"],
        ["calibrate", "pipe.csv", "--youngs-modulus", "1e6"],
        ["templates", "show", "pipe.toml"],
        ["calibrate", "/dev/zero", "--youngs-modulus", "1e6"],
        ["probe", "serial", "--set", "port=pipe.csv"],
        ["probe", "serial", "--set", "port=/dev/zero"],
        ["probe", "npz", "--set", "path=folder.npz"],
        ["plan", "demo", "--set", f"array.seed={'1' * 400}"],
    ]
    root = str(Path(__file__).parents[2])
    for arguments in faults.each(cases, short=3):
        done = subprocess.run(
            [sys.executable, "-m", "cnnum", *arguments],
            capture_output=True,
            text=True,
            timeout=60,
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": root},
        )
        if done.returncode != 2 or done.stderr.count("\n") != 1:
            faults.lose(f"{' '.join(arguments):.60}: {done.returncode} {done.stderr[-300:]}")


@pytest.mark.parametrize(
    "fault", [KeyError("x"), RecursionError("deep"), MemoryError(), ZeroDivisionError("a\nb")]
)
def test_own_faults(faults, monkeypatch, fault):
    """A fault of cnnum itself is one sentence with exit code 70; a variable shows its traceback."""

    def fails():
        raise fault

    monkeypatch.setattr(
        import_module(COMMANDS["devices"][0]), "command", click.Command("devices", callback=fails)
    )
    for _ in faults.trials(short=1, full=1):
        monkeypatch.delenv("CNNUM_TRACEBACK", raising=False)
        plain = CliRunner().invoke(main, ["devices"])
        monkeypatch.setenv("CNNUM_TRACEBACK", "1")
        shown = CliRunner().invoke(main, ["devices"])
        said = f"This is a fault of cnnum, not of your input ({type(fault).__name__}"
        if (plain.exit_code, plain.stderr.count("\n")) != (70, 1) or said not in plain.stderr:
            faults.lose(f"{plain.exit_code}: {plain.stderr}")
        if shown.exit_code != 70 or "Traceback (most recent call last)" not in shown.stderr:
            faults.lose(f"{shown.exit_code}: {shown.stderr}")
