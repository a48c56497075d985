"""The commands by name. A new command is one new file and one line here.

A command's module is imported when the command is called, so that `cnnum --help` is quick; it
holds the command as `command`.
"""

from collections.abc import Mapping

COMMANDS: Mapping[str, tuple[str, str]] = {
    "demo": ("cnnum.cli.demo", "Run the simulated scene and write a report of it."),
    "run": ("cnnum.cli.run", "Run a scene and print its events as they come."),
    "plan": ("cnnum.cli.plan", "Show what a scene would run, and what is left out."),
    "templates": ("cnnum.cli.templates", "List, show and check the template library."),
    "bench": ("cnnum.cli.bench", "Measure error against run time, speed, latency and the peers."),
    "devices": ("cnnum.cli.devices", "Show the OpenCL devices and what they reach."),
    "reproduce": (
        "cnnum.cli.reproduce",
        "Compare the dissertation's numbers and figures with ours.",
    ),
    "calibrate": ("cnnum.cli.calibrate", "Fit a taxel's calibration to a scan of point loads."),
    "score": ("cnnum.cli.score", "Score slip and twist where the truth is known."),
    "probe": ("cnnum.cli.probe", "Look at what an array sends: rate, losses, dead cells."),
    "record": ("cnnum.cli.record", "Record an array's frames to a file."),
    "recover": ("cnnum.cli.recover", "Make a whole recording of one that was cut off or damaged."),
    "replay": ("cnnum.cli.replay", "Run a scene's program over a recording."),
}
"""Name to module and to the line of help."""
