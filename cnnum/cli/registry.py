"""The commands by name. A new command is one new file and one line here.

A command's module is imported when the command is called, so that `cnnum --help` is quick; it
holds the command as `command`.
"""

from collections.abc import Mapping

COMMANDS: Mapping[str, tuple[str, str]] = {
    "demo": ("cnnum.cli.commands.demo", "Run the simulated scene and write a report of it."),
    "run": ("cnnum.cli.commands.run", "Run a scene and print its events as they come."),
    "plan": ("cnnum.cli.commands.plan", "Show what a scene would run, and what is left out."),
    "templates": ("cnnum.cli.commands.templates", "List, show and check the template library."),
    "bench": (
        "cnnum.cli.commands.bench",
        "Measure error against run time, speed, latency and the peers.",
    ),
    "devices": ("cnnum.cli.commands.devices", "Show the OpenCL devices and what they reach."),
    "reproduce": (
        "cnnum.cli.commands.reproduce",
        "Compare the dissertation's numbers and figures with ours.",
    ),
    "calibrate": (
        "cnnum.cli.commands.calibrate",
        "Fit a taxel's calibration to a scan of point loads.",
    ),
    "score": ("cnnum.cli.commands.score", "Score slip and twist where the truth is known."),
    "probe": ("cnnum.cli.commands.probe", "Look at what an array sends: rate, losses, dead cells."),
    "record": ("cnnum.cli.commands.record", "Record an array's frames to a file."),
    "recover": (
        "cnnum.cli.commands.recover",
        "Make a whole recording of one that was cut off or damaged.",
    ),
    "replay": ("cnnum.cli.commands.replay", "Run a scene's program over a recording."),
}
"""Name to module and to the line of help."""
