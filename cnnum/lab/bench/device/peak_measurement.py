"""The measured speed of a device: its peak of multiply-adds and its bandwidth.

The kernels run in a process of their own, which names each before its try: some OpenCL compilers
end the whole process on a kernel that they cannot build. That shall cost that kernel and no more.
The peak is that of the best kernel, because compilers differ.
"""

import json
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

from cnnum.engines.devices.child import run_child
from cnnum.engines.devices.listing import Device, list_devices
from cnnum.engines.devices.selection import verdict_on
from cnnum.errors import DeviceError
from cnnum.lab.bench.device.peak_kernels import Bench, arithmetic_kernels

PATIENCE_S = 60.0
"""s after which a device that answers nothing is given up."""

COPY_WIDTHS = (4, 16)


@dataclass(frozen=True, slots=True)
class Figures:
    """The figures of a device, each the best of several runs of several kernels.

    Attributes
    ----------
    flops : float
        Single-precision operations a second; a multiply-add counts as two.
    bandwidth : float
        B/s, bytes read and bytes written together.
    kernel : str
        The arithmetic kernel that was the fastest.
    kernels : int
        Arithmetic kernels that ran.
    failed : str
        The kernel on which the device's compiler gave up; empty if none.
    seconds : float
        s that the measurement took.
    """

    flops: float
    bandwidth: float
    kernel: str
    kernels: int
    failed: str
    seconds: float


def measure(device: Device, *, budget: float = 3.5) -> Figures:
    """Measure a device.

    Parameters
    ----------
    device : Device
        One of `list_devices()`.
    budget : float
        s after which no further kernel is tried; a copying and an arithmetic one always are.

    Raises
    ------
    DeviceError
        If the device runs none of the kernels.
    """
    begin = time.perf_counter()
    place = [known.handle for known in list_devices()].index(device.handle)
    tried, records = _lines(_child(place, budget))
    copies = [value for kind, _, value in records if kind == "copy"]
    flops = [(value, label) for kind, label, value in records if kind == "arithmetic"]
    if not copies or not flops:
        raise DeviceError(
            f"Device '{device.label}' cannot be measured: it failed at '{tried}'; check its "
            "OpenCL driver."
        )
    best, kernel = max(flops)
    return Figures(best, max(copies), kernel, len(flops), tried, time.perf_counter() - begin)


def _child(place: int, budget: float) -> str:
    """Return the output of the measuring process before it ended, however it ended."""
    return run_child(__spec__.name, [str(place), str(budget)], PATIENCE_S).said


def _lines(text: str) -> tuple[str, list[tuple[str, str, float]]]:
    """Return the kernel that was begun and not ended, and (kind, label, value) of the others."""
    begun, records = "the start", list[tuple[str, str, float]]()
    for line in text.splitlines():
        kind, label, value = json.loads(line)
        begun = label if kind == "try" else ""
        if kind in ("copy", "arithmetic"):
            records.append((kind, label, value))
    return begun, records


def _attempts(device: Device, budget: float) -> Iterator[tuple[str, str, float]]:
    """Yield each try and then its outcome."""
    until, bench = time.perf_counter() + budget, Bench(device)
    for width in COPY_WIDTHS:
        label = f"copy of {width} numbers a work item"
        yield "try", label, 0.0
        yield "copy", label, bench.bandwidth(width)
    for kernel in arithmetic_kernels():
        yield "try", kernel.label, 0.0
        yield "arithmetic", kernel.label, bench.flops(kernel)
        if time.perf_counter() > until:
            return


def _report(place: int, budget: float) -> None:
    device = list_devices()[place]
    if not verdict_on(device).works:
        return
    for attempt in _attempts(device, budget):
        print(json.dumps(attempt), flush=True)


if __name__ == "__main__":
    _report(int(sys.argv[1]), float(sys.argv[2]))
