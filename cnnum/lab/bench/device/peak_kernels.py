"""Kernels that show the speed of a device, and their timing on it."""

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

from cnnum.engines.devices.building import build_program
from cnnum.engines.devices.listing import Device

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
        text = Template((resources.files("cnnum.lab.bench.device") / "measure.cl").read_text())
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
        """Return operations a second, the best of several runs; a multiply-add is two."""
        rate = self.rate(arithmetic)
        return max(rate() for _ in range(repeats))

    def rate(self, arithmetic: Arithmetic) -> Callable[[], float]:
        """Return a function that runs the kernel about `RUN_S`, for operations a second."""
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
        """Return bytes a second, read and written together, of a copy of such vectors."""
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
        return cl.Kernel(build_program(self._context, arithmetic.text), name)

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
