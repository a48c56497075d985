"""The commands by name. A new command is one new file and one line here.

A command's module is imported when the command is called, so that `cnnum --help` is quick. The
module holds the command as `command`.
"""

from collections.abc import Mapping

ROOM = "cnnum.cli.commands"
ARRAYS = "cnnum.cli.arrays"

COMMANDS: Mapping[str, tuple[str, str]] = {
    "demo": (f"{ROOM}.demo", "Run the simulated scene and write a report of it."),
    "run": (f"{ROOM}.run", "Run a scene and print its events as they come."),
    "plan": (f"{ROOM}.plan", "Show the operations of a scene, and those left out."),
    "templates": (f"{ROOM}.templates", "List, show and check the template library."),
    "bench": (
        f"{ROOM}.bench",
        "Measure error against run time, speed, latency and the peers.",
    ),
    "sweep": ("cnnum.cli.library.sweep", "Sweep a template over weights, sizes and noise."),
    "devices": (f"{ROOM}.devices", "Show the OpenCL devices and their speed."),
    "stability": (
        f"{ROOM}.stability",
        "Run stiff, marginal and extreme cases on every engine.",
    ),
    "reproduce": (
        f"{ROOM}.reproduce",
        "Compare the dissertation's numbers and figures with ours.",
    ),
    "calibrate": (
        f"{ROOM}.calibrate",
        "Fit a taxel's calibration to a scan of point loads.",
    ),
    "score": (f"{ROOM}.score", "Score slip and twist where the truth is known."),
    "probe": (f"{ROOM}.probe", "Measure an array's rate, losses and dead cells."),
    "simulate": (
        f"{ARRAYS}.simulate",
        "Offer a simulated array at a port, with faults.",
    ),
    "export": (f"{ROOM}.export", "Write a program as C99 for a microcontroller."),
    "record": (f"{ROOM}.record", "Record an array's frames to a file."),
    "recover": (
        f"{ROOM}.recover",
        "Make a whole recording of one that was cut off or damaged.",
    ),
    "lerobot": (f"{ARRAYS}.lerobot", "Write a recording as a data set of LeRobot."),
    "view": (f"{ARRAYS}.view", "Show an array or a recording in a browser."),
    "replay": (f"{ROOM}.replay", "Run a scene's program over a recording."),
}
"""Name to module and to the line of help."""
