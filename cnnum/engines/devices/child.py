"""Work on a device in a process of its own: some OpenCL compilers end the process they run in."""

import os
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass

SAFE_PATH = "PYTHONSAFEPATH"
"""Variable of the environment that keeps the working folder off Python's path."""


@dataclass(frozen=True, slots=True)
class Ended:
    """How a child process ended.

    Attributes
    ----------
    said : str
        Its standard output.
    complained : str
        Its standard error.
    code : int or None
        Its exit code, less than 0 for a signal; None if it was late and was ended.
    """

    said: str
    complained: str
    code: int | None


def run_child(module: str, arguments: list[str], patience: float) -> Ended:
    """Run a module of this package in a process of its own.

    Parameters
    ----------
    module : str
        Its full name; it runs as a script.
    arguments : list of str
    patience : float
        s after which it is ended.
    """
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", module, *arguments],  # no module of the working folder
            capture_output=True,
            stdin=subprocess.DEVNULL,
            timeout=patience,
            check=False,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
    except subprocess.TimeoutExpired as late:
        return Ended(_text(late.stdout), _text(late.stderr), None)
    return Ended(_text(done.stdout), _text(done.stderr), done.returncode)


@contextmanager
def safe_path() -> Generator[None]:
    """Let a process that starts find no module in the working folder, which may be another's."""
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[SAFE_PATH]
        else:
            os.environ[SAFE_PATH] = before


def _text(raw: bytes | None) -> str:
    return (raw or b"").decode(errors="replace")
