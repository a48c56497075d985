"""A small kernel with a known answer: a device is used only after it has shown that it works.

The kernel is built and run in a process of its own, for a compiler can end the process: `python -m
cnnum.engines.devices.self_test PLACE [TARGET]`.
"""

import json
import signal
import sys
from importlib import resources
from string import Template

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cnnum.engines.devices.building import build_program
from cnnum.engines.devices.child import Ended, run_child
from cnnum.engines.devices.inline import partner_of
from cnnum.engines.devices.listing import Device, list_devices
from cnnum.engines.devices.pocl_wheel import rename_target

PATIENCE_S = 120.0
"""s after which a device that gives no answer counts as broken: a first build takes under ten."""

ROUNDS, ITEMS = 23, 5

LONGEST = 160
"""Letters of a compiler's complaint that a reason keeps."""


def try_in_child(device: Device, target: str | None) -> tuple[str, bool]:
    """Try a device in a process of its own.

    Parameters
    ----------
    device : Device
        One of `list_devices()`.
    target : str or None
        Name to give to its processor before (`pocl_wheel.py`).

    Returns
    -------
    str
        Why it does not work; empty where it does.
    bool
        Whether the device is the cause. One that was late may do better another time. An error of
        Python, as with a cache folder that is damaged, is no word of the device.
    """
    place = [known.handle for known in list_devices()].index(device.handle)
    arguments = [str(place)] if target is None else [str(place), target]
    ended = run_child(__spec__.name, arguments, PATIENCE_S)
    return _why(ended), ended.code is not None and ended.code <= 0


def _why(ended: Ended) -> str:
    lines = ended.said.splitlines()
    if ended.code == 0 and lines:
        return str(json.loads(lines[-1]))
    if ended.code is None:
        return f"it gave no answer in {PATIENCE_S:g} s"
    how = f"exit code {ended.code}" if ended.code >= 0 else signal.strsignal(-ended.code)
    last = [line.strip() for line in ended.complained.splitlines() if line.strip()][-1:]
    return f"it ended the process that tried it ({': '.join([str(how), *last])})"[:LONGEST]


def run_self_test(device: cl.Device, lanes: int, *, double: bool) -> str:
    """Build and run the kernel here; return why it fails, or nothing."""
    context = cl.Context([device])
    queue = cl.CommandQueue(context)
    for dtype in (np.dtype(np.float32), *((np.dtype(np.float64),) if double else ())):
        width = max(1, lanes * 4 // dtype.itemsize)
        try:
            got = _run(context, queue, dtype, width)
        except cl.Error as error:
            return f"it refuses a small kernel ({_complaint(str(error))})"
        if not np.array_equal(got, _expected(dtype, width)):
            return f"a small kernel gives wrong numbers in {dtype.name}"
    return ""


def _run(
    context: cl.Context, queue: cl.CommandQueue, dtype: np.dtype[np.floating], width: int
) -> NDArray[np.floating]:
    text = _text("float" if dtype == np.float32 else "double", width)
    scalar = "#define READ(at, from) (from)[at]\n#define WRITE(value, at, to) (to)[at] = (value)\n"
    program = build_program(context, scalar + text, ["-w"])
    start = _start(dtype, width)
    end = np.zeros_like(start)
    flags = cl.mem_flags
    given = cl.Buffer(context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=start)
    taken = cl.Buffer(context, flags.WRITE_ONLY, end.nbytes)
    kernel = cl.Kernel(program, "self_test")
    kernel.set_args(given, taken, np.int32(ROUNDS))
    cl.enqueue_nd_range_kernel(queue, kernel, (ITEMS,), None)
    cl.enqueue_copy(queue, end, taken)
    return end


def _text(real: str, width: int) -> str:
    """Return the kernel for vectors of a width."""
    file = resources.files("cnnum.engines.devices") / "self_test.cl"
    return Template(file.read_text()).substitute(
        real=real,
        vector=real if width == 1 else f"{real}{width}",
        load="READ" if width == 1 else f"vload{width}",
        store="WRITE" if width == 1 else f"vstore{width}",
    )


def _start(dtype: np.dtype[np.floating], width: int) -> NDArray[np.floating]:
    return np.arange(ITEMS * width, dtype=dtype) % 61


def _expected(dtype: np.dtype[np.floating], width: int) -> NDArray[np.floating]:
    """Return the same in whole numbers."""
    state = _start(dtype, width).astype(np.int64)
    kept = [state, state]
    for turn in range(ROUNDS):
        state = (kept[turn & 1] * 3 + state + turn + 1) % 64
        if turn & 3 == 3:
            state = np.maximum(state, kept[0]) + 1
        kept[turn & 1] = state
    return state.astype(dtype)


def _complaint(text: str) -> str:
    """Return the line of a build log that names the error."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    errors = [line for line in lines if "error" in line.lower() or "unknown" in line.lower()]
    return (errors[-1:] or lines[:1] or ["no reason given"])[0][:LONGEST]


def _main(place: int, target: str | None) -> None:
    device = list_devices()[place]
    partner = partner_of(device.handle)
    why = ""
    for handle in [device.handle] + ([] if partner is None else [partner]):
        if target is not None:
            rename_target(handle, target)
        why = why or run_self_test(handle, device.lanes, double=device.double)
    print(json.dumps(why), flush=True)


if __name__ == "__main__":
    _main(int(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else None)
