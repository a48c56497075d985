"""A processor as a device that runs kernels in the thread that asks for them.

A launch on the usual device of a processor wakes a thread of its pool. The pool wakes the host
again. That takes 20 to 60 µs on a virtual machine, more than the work of a small frame. Threads
cannot share such a frame anyway. PoCL has a second device for the same processor that does neither
("basic"; "cpu-minimal" from version 4 on). PoCL offers it only where it is asked for by name.
"""

import os
import threading
from collections.abc import Generator
from contextlib import contextmanager

import pyopencl as cl

VARIABLE = "POCL_DEVICES"
"""PoCL reads it once: 3.1 when its platform is listed first, 3.0 when its devices are. Names that
it does not know are passed over. A value of the user's own stands."""

KINDS = {"pthread-": "basic-", "cpu-": "cpu-minimal-"}
"""How the names of the two devices of a processor begin; the rest of the names is the same."""

_LOCK = threading.Lock()


@contextmanager
def asked_for() -> Generator[None]:
    """List platforms and devices within the block: PoCL offers both devices of a processor."""
    if VARIABLE in os.environ:
        yield
        return
    with _LOCK:
        os.environ[VARIABLE] = "pthread basic cpu cpu-minimal"
        try:
            yield
        finally:
            os.environ.pop(VARIABLE, None)


def partner_of(device: cl.Device) -> cl.Device | None:
    """Return the device that runs the same processor's kernels in the thread that asks."""
    name = str(device.name)
    wanted = [own + name[len(usual) :] for usual, own in KINDS.items() if name.startswith(usual)]
    found = (other for other in device.platform.get_devices() if str(other.name) in wanted)
    return next(found, None)


def without_partners(devices: list[cl.Device]) -> list[cl.Device]:
    """Return a platform's devices without those that only stand in for another of them."""
    partners = [partner_of(device) for device in devices]
    return [device for device in devices if device not in partners]
