"""Running device work in a child process, and describing its failures."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import pyopencl as cl

from cnnum.errors import CnnumError, DeviceError, NotSupportedError, SizeError

OTHERWISE = "or take another device or Engine('numba')"


def build_failure(source: str, error: cl.Error, device: cl.Device) -> NotSupportedError:
    """Return the error for a kernel that a compiler rejects; its source and log go to a file.

    Parameters
    ----------
    source : str
        Text of the kernel.
    error : pyopencl.Error
        Its text holds the compiler's log.
    device : pyopencl.Device
    """
    driver = f"{device.platform.name}, {device.name}, {device.driver_version}"
    text = f"/*\n{driver}\n\n{str(error).replace('*/', '* /')}\n*/\n{source}"
    where = "no file could be written for its text and log"
    with suppress(OSError):
        # the user's to look at, so it stays
        with tempfile.NamedTemporaryFile(
            "w", prefix="cnnum-kernel-", suffix=".cl", delete=False, encoding="utf-8"
        ) as file:
            file.write(text)
        where = f"the kernel's text and the compiler's log are in '{file.name}'"
    return NotSupportedError(
        f"The OpenCL compiler of '{device.name}' rejects the kernel of a plan; {where}: report "
        f"it, {OTHERWISE}."
    )


def run_failure(error: cl.Error, queue: cl.CommandQueue) -> CnnumError:
    """Return the error for a run that a device did not complete, for lack of memory or otherwise.

    Parameters
    ----------
    error : pyopencl.Error
    queue : pyopencl.CommandQueue
        Waited for, as long as the device answers.
    """
    with suppress(cl.Error):
        queue.finish()
    name = queue.device.name
    if isinstance(error, cl.MemoryError):
        return SizeError(
            f"Device '{name}' ran out of memory in this run ({_first_line(error)}): give fewer "
            f"frames at a time, {OTHERWISE}."
        )
    return DeviceError(
        f"Device '{name}' did not finish a run ({_first_line(error)}): it may be lost; make a "
        f"new engine, {OTHERWISE}."
    )


def _first_line(error: cl.Error) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


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
        Its exit code, less than 0 for a signal, or None if it was late and was ended.
    """

    said: str
    complained: str
    code: int | None


def run_child(module: str, arguments: list[str], patience: float) -> Ended:
    """Run a module of this package in a child process.

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
    """Keep child processes from importing modules from the working folder, which may be
    untrusted.
    """
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
