"""The measured speed of a device: its peak of multiply-adds and its bandwidth.

The kernels run in a process of their own, which names each before its try: some OpenCL compilers
end the whole process on a kernel that they cannot build. That shall cost that kernel and no more.
The peak is that of the best kernel, because compilers differ.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib import resources
from itertools import product
from string import Template
from textwrap import indent

import numpy as np
import pyopencl as cl

from cnnum.engines.devices.child import run_child
from cnnum.engines.devices.listing import Device, list_devices
from cnnum.engines.devices.program_cache import build_program, make_kernel
from cnnum.engines.devices.selection import verdict_on
from cnnum.errors import DeviceError

FORMS = {"a*b + c": "{0} * factor + term", "fma(a, b, c)": "fma({0}, factor, term)"}
"""Ways to write a multiply-add."""

SHAPES = ((8, 8), (16, 8), (8, 16), (4, 8), (1, 16))
"""Numbers a vector and independent chains; more than 128 numbers do not fit the registers."""

RUN_S = 0.02
"""s that one timed run takes: far above the cost of a launch and the clock's grain."""

COPIED_BYTES = 128 * 2**20
"""Size of each of the two arrays of a copy: together more than the caches hold."""


@dataclass(frozen=True, slots=True)
class Arithmetic:
    """A kernel that multiplies and adds.

    Attributes
    ----------
    width : int
        Numbers a vector.
    chains : int
        Independent sums a work item.
    form : str
        One of `FORMS`.
    """

    width: int
    chains: int
    form: str = "a*b + c"

    @property
    def label(self) -> str:
        """The kernel in words."""
        return f"{self.form}, {vector_type(self.width)}, {self.chains} chains"

    @property
    def text(self) -> str:
        """The kernel's text."""
        names = [f"chain{n}" for n in range(self.chains)]
        vector = vector_type(self.width)
        begin = [f"{vector} {name} = start[2] + {n}.0f;" for n, name in enumerate(names)]
        step = [f"{name} = {FORMS[self.form].format(name)};" for name in names]
        text = Template((resources.files("cnnum.engines.devices") / "measure.cl").read_text())
        return text.substitute(
            vector=vector,
            begin=indent("\n".join(begin), " " * 4),
            step=indent("\n".join(step), " " * 8),
            sum=" + ".join(names),
        )


def vector_type(width: int) -> str:
    """Return the OpenCL type of a number of single-precision numbers."""
    return "float" if width == 1 else f"float{width}"


def arithmetic_kernels() -> Iterator[Arithmetic]:
    """Yield the kernels to try.

    Those with ``fma()`` come last: on some builds of PoCL it is a function call, and a wide one
    cannot be compiled at all.
    """
    for form, (width, chains) in product(FORMS, SHAPES):
        yield Arithmetic(width, chains, form)


class Bench:
    """A queue on a device that times kernels."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._context = cl.Context([device.handle])
        self._queue = cl.CommandQueue(self._context)

    def flops(self, arithmetic: Arithmetic, repeats: int = 5) -> float:
        """Return operations per second, the best of several runs; a multiply-add is two."""
        rate = self.rate(arithmetic)
        return max(rate() for _ in range(repeats))

    def rate(self, arithmetic: Arithmetic) -> Callable[[], float]:
        """Return a function that runs the kernel about `RUN_S`, for operations per second."""
        kernel = self._kernel(arithmetic, "arithmetic")
        items, group = self._items(arithmetic.width)
        start = np.repeat(np.array([0.999, 0.001, 0.5], np.float32), arithmetic.width)
        flags = cl.mem_flags
        read = cl.Buffer(self._context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=start)
        written = cl.Buffer(self._context, flags.WRITE_ONLY, 4 * arithmetic.width * items)

        def run(rounds: int) -> None:
            kernel(self._queue, (items,), (group,), read, written, np.int32(rounds))

        rounds = self._rounds(run)
        operations = 2.0 * arithmetic.width * arithmetic.chains * items * rounds
        return lambda: operations / self._seconds(partial(run, rounds))

    def bandwidth(self, width: int, repeats: int = 5) -> float:
        """Return bytes per second, read and written together, of a copy of such vectors."""
        kernel = self._kernel(Arithmetic(width, 1), "copy")
        handle = self._device.handle
        room = min(COPIED_BYTES, handle.max_mem_alloc_size, handle.global_mem_size // 8)
        items = int(room) // (4 * width * 64) * 64
        size, flags = 4 * width * items, cl.mem_flags
        there, here = (cl.Buffer(self._context, flags.READ_WRITE, size) for _ in range(2))
        one = np.ones(1, np.float32)
        for buffer in (there, here):  # pages that were never written may not exist yet
            cl.enqueue_fill_buffer(self._queue, buffer, one, 0, size)
        self._queue.finish()
        copy = self._best(lambda: kernel(self._queue, (items,), (64,), there, here), repeats)
        return 2.0 * size / copy

    def _kernel(self, arithmetic: Arithmetic, name: str) -> cl.Kernel:
        return make_kernel(build_program(self._context, arithmetic.text), name)

    def _items(self, width: int) -> tuple[int, int]:
        """Return work items and those of a group: enough to keep every unit busy."""
        group = 256 if self._device.kind == "GPU" else max(1, 16 // width)
        return group * self._device.units * 16, group

    def _rounds(self, run: Callable[[int], None]) -> int:
        """Return how many rounds take about `RUN_S`."""
        rounds, seconds = 16, 0.0
        while seconds < RUN_S / 4:
            rounds *= 4
            self._seconds(partial(run, rounds))  # the first launch may still compile
            seconds = self._seconds(partial(run, rounds))
        return max(1, round(rounds * RUN_S / seconds))

    def _best(self, run: Callable[[], object], repeats: int) -> float:
        return min(self._seconds(run) for _ in range(repeats))

    def _seconds(self, run: Callable[[], object]) -> float:
        begin = time.perf_counter()
        run()
        self._queue.finish()
        return time.perf_counter() - begin


PATIENCE_S = 60.0
"""Timeout, s, after which an unresponsive device is given up."""

COPY_WIDTHS = (4, 16)


@dataclass(frozen=True, slots=True)
class Figures:
    """The figures of a device, each the best of several runs of several kernels.

    Attributes
    ----------
    flops : float
        Single-precision operations per second; a multiply-add counts as two.
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
