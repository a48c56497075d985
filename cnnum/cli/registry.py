"""The commands by name. A new command is one new file and one line here.

A command's module is imported when the command is called, so that `cnnum --help` is quick; it
holds the command as `command`.
"""

from collections.abc import Mapping

ROOM = "cnnum.cli.commands"

COMMANDS: Mapping[str, tuple[str, str]] = {
    "demo": (f"{ROOM}.demo", "Run the simulated scene and write a report of it."),
    "run": (f"{ROOM}.run", "Run a scene and print its events as they come."),
    "plan": (f"{ROOM}.plan", "Show what a scene would run, and what is left out."),
    "templates": (f"{ROOM}.templates", "List, show and check the template library."),
    "bench": (
        f"{ROOM}.bench",
        "Measure error against run time, speed, latency and the peers.",
    ),
    "sweep": (f"{ROOM}.sweep", "Run a template over weights, sizes, noise and mismatch."),
    "devices": (f"{ROOM}.devices", "Show the OpenCL devices and what they reach."),
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
    "probe": (f"{ROOM}.probe", "Look at what an array sends: rate, losses, dead cells."),
    "record": (f"{ROOM}.record", "Record an array's frames to a file."),
    "recover": (
        f"{ROOM}.recover",
        "Make a whole recording of one that was cut off or damaged.",
    ),
    "replay": (f"{ROOM}.replay", "Run a scene's program over a recording."),
}
"""Name to module and to the line of help."""
