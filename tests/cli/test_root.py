"""The root: help without imports, a version, every command's own help."""

import inspect
import subprocess
import sys
from importlib import import_module

import click
import pytest

import cnnum
from cnnum.cli.root import COMMANDS


def test_help_lists_every_command_and_imports_none(call):
    text = call("--help").stdout
    assert all(name in text and line in text for name, (_, line) in COMMANDS.items())
    assert call().stdout == text
    code = "import sys; from cnnum.cli import main\ntry: main(['--help'])\nfinally: "
    code += "print('loaded', *sys.modules)"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout
    loaded = {name.split(".")[0] for name in shown.split("loaded", 1)[1].split()}
    assert not loaded & {"numpy", "scipy", "pyopencl", "rich", "serial", "matplotlib"}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_and_json(call, name):
    result = call(name, "--help")
    assert result.exit_code == 0
    assert f"Usage: cnnum {name}" in result.stdout
    room = import_module(COMMANDS[name][0])
    members = room.command.commands if isinstance(room.command, click.Group) else ()
    assert members or "--json" in result.stdout
    for member in members:
        assert "--json" in call(name, member, "--help").stdout


def leaves_of(command):
    """Yield the commands that do work: a command itself, or all below a group."""
    if not isinstance(command, click.Group):
        yield command
        return
    for member in command.commands.values():
        yield from leaves_of(member)


SCENE_OPTIONS = ("settings", "engine", "device", "precision")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_given_what_its_function_takes(name):
    room = import_module(COMMANDS[name][0])
    for command in leaves_of(room.command):
        given = {option.name: None for option in command.params}
        taken = inspect.signature(command.callback)
        if "changes" in taken.parameters:  # `scene_options` makes it of four options
            given["changes"] = [given.pop(key) for key in SCENE_OPTIONS]
        taken.bind(**given, **({"ctx": None} if "ctx" in taken.parameters else {}))


def test_version(call):
    assert cnnum.__version__ in call("--version").stdout
