"""Trouble with a device in one sentence: a kernel that it does not build, memory, a device lost."""

import tempfile
from contextlib import suppress

import pyopencl as cl

from cnnum.errors import CnnumError, DeviceError, NotSupportedError, SizeError

OTHERWISE = "or take another device or Engine('numba')"


def build_failure(source: str, error: cl.Error, device: cl.Device) -> NotSupportedError:
    """Return the error of a kernel that a compiler refuses; its text and log go to a file.

    Parameters
    ----------
    source : str
        Text of the kernel.
    error : pyopencl.Error
        Its text holds the compiler's log.
    device : pyopencl.Device
    """
    about = f"{device.platform.name}, {device.name}, {device.driver_version}"
    text = f"/*\n{about}\n\n{str(error).replace('*/', '* /')}\n*/\n{source}"
    where = "no file could be written for its text and log"
    with suppress(OSError):
        # the user's to look at, so it stays
        with tempfile.NamedTemporaryFile(
            "w", prefix="cnnum-kernel-", suffix=".cl", delete=False, encoding="utf-8"
        ) as file:
            file.write(text)
        where = f"the kernel's text and the compiler's log are in '{file.name}'"
    return NotSupportedError(
        f"The OpenCL compiler of '{device.name}' refuses the kernel of a plan; {where}: report "
        f"it, {OTHERWISE}."
    )


def run_failure(error: cl.Error, queue: cl.CommandQueue) -> CnnumError:
    """Return the error of a run that a device did not end: of its memory, or of any other kind.

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
            f"Device '{name}' has no memory left for this run ({_first_line(error)}): "
            f"give fewer frames at a time, {OTHERWISE}."
        )
    return DeviceError(
        f"Device '{name}' did not finish a run ({_first_line(error)}): it may be lost; make a "
        f"new engine, {OTHERWISE}."
    )


def _first_line(error: cl.Error) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
