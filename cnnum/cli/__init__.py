"""The command line: `cnnum run`, `cnnum demo`, … one file per command or group."""

from cnnum.cli.root import main

__all__ = ["main"]
