"""The commands that measure and verify, by name.

The command line offers them where this folder is installed.
"""

from collections.abc import Mapping

ROOM = "cnnum.lab.commands"

COMMANDS: Mapping[str, tuple[str, str]] = {
    "bench": (f"{ROOM}.bench", "Measure error and speed, and compare with other libraries."),
    "stability": (f"{ROOM}.stability", "Run stiff, marginal and extreme cases on every engine."),
    "reproduce": (f"{ROOM}.reproduce", "Compare our results with those of the dissertation."),
    "score": (f"{ROOM}.score", "Score slip and twist where the truth is known."),
}
"""Name to module and to the line of help."""
