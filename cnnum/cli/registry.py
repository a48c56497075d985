"""The commands by name. A new command is one new file and one line here.

A command's module is imported when the command is called, so that `cnnum --help` is quick. The
module holds the command as `command`. Those that measure and verify live in `cnnum.lab`, which
may be left out of an installation.
"""

from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import cast

ROOM = "cnnum.cli.commands"
ARRAYS = "cnnum.cli.arrays"
LAB = "cnnum.lab"

_SERVING: Mapping[str, tuple[str, str]] = {
    "demo": (f"{ROOM}.demo", "Run a simulated scene and write a report."),
    "run": (f"{ROOM}.run", "Run a scene and print its events as they come."),
    "plan": (f"{ROOM}.plan", "Show the operations of a scene and what it leaves out."),
    "templates": (f"{ROOM}.templates", "List, show and check the template library."),
    "sweep": ("cnnum.cli.library.sweep", "Sweep a template over weights, sizes and noise."),
    "devices": (f"{ROOM}.devices", "Show the OpenCL devices and their speed."),
    "calibrate": (
        f"{ROOM}.calibrate",
        "Fit the calibration of a taxel to a scan of point loads.",
    ),
    "probe": (f"{ROOM}.probe", "Measure an array's rate, losses and dead cells."),
    "simulate": (
        f"{ARRAYS}.simulate",
        "Simulate an array at a serial port, with faults on request.",
    ),
    "export": (f"{ROOM}.export", "Write a program as C99 for a microcontroller."),
    "record": (f"{ROOM}.record", "Record an array's frames to a file."),
    "recover": (
        f"{ROOM}.recover",
        "Rescue a recording that was cut off or damaged.",
    ),
    "check": (f"{ARRAYS}.check", "Check order, signs, rate, rest and taxels of a recording."),
    "layout": (f"{ARRAYS}.layout", "Propose the layout of a data file, and draw a frame."),
    "lerobot": (f"{ARRAYS}.lerobot", "Write a recording as a data set of LeRobot."),
    "view": (f"{ARRAYS}.view", "Show an array or a recording in a browser."),
    "replay": (f"{ROOM}.replay", "Run the program of a scene over a recording."),
}
"""The commands that serve: name to module and to the line of help."""


def _lab() -> Mapping[str, tuple[str, str]]:
    if find_spec(LAB) is None:
        return {}
    return cast("Mapping[str, tuple[str, str]]", import_module(f"{LAB}.commands").COMMANDS)


COMMANDS = {**_SERVING, **_lab()}
"""All commands of this installation."""
