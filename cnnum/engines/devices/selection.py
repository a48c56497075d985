"""Device selection: the fastest CPU device that passes a self-test, or the one requested.

A small kernel with a known answer: a device is used only after it has shown that it works.

The kernel is built and run in a process of its own, for a compiler can end the process: `python -m
cnnum.engines.devices.self_test PLACE [TARGET]`.

Verdicts on devices, kept from one process to the next: a device shows only once that it works.

A verdict holds for one driver, device, processor and version of the packages. It is a small entry
of the cache; where none can be kept, every process tries its device anew.
"""

import hashlib
import json
import os
import signal
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib import resources
from importlib.metadata import PackageNotFoundError, version
from string import Template
from typing import cast

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cnnum.engines.cache import Shelf
from cnnum.engines.devices.child import Ended, run_child
from cnnum.engines.devices.listing import Device, list_devices, partner_of
from cnnum.engines.devices.pocl import remedy_for, rename_target
from cnnum.engines.devices.program_cache import build_program, make_kernel
from cnnum.engines.notices import how_to_get_opencl, processor
from cnnum.errors import DeviceError, NoOpenCLError, say_once
from cnnum.version import __version__

PATIENCE_S = 120.0
"""Timeout, s, after which a silent device counts as broken: a first build takes under ten."""

ROUNDS, ITEMS = 23, 5

LONGEST = 160
"""Letters of a compiler's complaint that a reason keeps."""


def try_in_child(device: Device, target: str | None) -> tuple[str, bool]:
    """Test a device in a child process.

    Parameters
    ----------
    device : Device
        One of `list_devices()`.
    target : str or None
        Name to give to its processor before (`pocl.py`).

    Returns
    -------
    str
        Why it does not work; empty if it does.
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
    kernel = make_kernel(program, "self_test")
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


SHELF = Shelf("verdicts")

PACKAGES = ("pyopencl", "pocl-binary-distribution")


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a device works.

    Attributes
    ----------
    why : str
        Why it does not; empty if it does.
    target : str or None
        Name that its processor is given first (`pocl.py`), or None if it needs none.
    """

    why: str
    target: str | None

    @property
    def works(self) -> bool:
        """Whether it works."""
        return not self.why


def subject_of(device: Device, target: str | None) -> Mapping[str, str]:
    """Return all that a verdict depends on."""
    here = processor()
    flags = hashlib.sha256(" ".join(sorted(here.flags)).encode()).hexdigest()
    return {
        "cnnum": __version__,
        **{package: _version(package) for package in PACKAGES},
        "platform": device.platform_version,
        "device": device.label,
        "version": device.version,
        "processor": f"{here.name}, family {here.family}, model {here.model}, {flags}",
        "devices": os.environ.get("POCL_DEVICES", ""),
        "target": target or "",
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def _name(subject: Mapping[str, str]) -> str:
    digits = hashlib.sha256(json.dumps(subject, sort_keys=True).encode()).hexdigest()
    return f"{digits[:24]}.json"


def kept_verdict(subject: Mapping[str, str]) -> Verdict | None:
    """Return the verdict that was kept, or None if there is none, or none that can be read."""
    text = SHELF.get(_name(subject))
    try:
        record = cast(object, None if text is None else json.loads(text))
    except ValueError:
        return None
    if not isinstance(record, dict):
        return None
    kept = cast(dict[str, object], record)
    why, target = kept.get("why"), kept.get("target")
    if kept.get("subject") != subject or not isinstance(why, str):
        return None
    return Verdict(why, target) if target is None or isinstance(target, str) else None


def keep_verdict(subject: Mapping[str, str], verdict: Verdict) -> None:
    """Keep a verdict, if there is a folder that can be written."""
    record = {"subject": subject, **asdict(verdict)}
    SHELF.put(_name(subject), json.dumps(record, indent=1).encode())


_KNOWN = dict[int, Verdict]()
"""Verdicts of this process, by the address of the device's record, which a repair changes."""


def choose_device(name: str | None) -> Device:
    """Return the first of `devices_named` that works, ready for use.

    Parameters
    ----------
    name : str or None
        Part of a platform's, device's or driver's name; any unless given.

    Raises
    ------
    DeviceError
        If there is none of that name.
    NoOpenCLError
        If none of them works.
    """
    reasons = list[str]()
    for device in devices_named(name):
        verdict = verdict_on(device)
        if verdict.works:
            for reason in reasons:
                say_once(f"OpenCL device {reason}; it is passed over.")
            return device
        reasons.append(f"'{device.label}' does not work: {verdict.why}")
    raise NoOpenCLError(", and ".join(reasons), how_to_get_opencl())


def working_devices() -> tuple[Device, ...]:
    """Return all devices that work, ready for use; none where there is no OpenCL."""
    try:
        devices = list_devices()
    except NoOpenCLError:
        return ()
    return tuple(device for device in devices if verdict_on(device).works)


def devices_named(name: str | None) -> list[Device]:
    """Return the devices of that name, whether they work or not, in the order of preference.

    Processors come first, and among them the one that promises most. A frame of a small array is
    one work item, which takes a single lane of a GPU several times as long as a processor's core.

    Raises
    ------
    DeviceError
        If there is no such name.
    """
    if not isinstance(cast(object, name), str | None):
        raise DeviceError(f"A device must be named by a part of its label, got {name!r:.60}.")
    devices = list_devices()
    matching = [d for d in devices if name is None or name.lower() in d.label.lower()]
    if not matching:
        known = ", ".join(f"'{d.label}'" for d in devices)
        raise DeviceError(f"No OpenCL device matches {name!r:.60}: there are {known}.")
    return sorted(matching, key=lambda device: (device.kind == "GPU", -device.promise))


def verdict_on(device: Device, *, anew: bool = False) -> Verdict:
    """Return whether a device works; one that does is ready for use.

    Parameters
    ----------
    device : Device
    anew : bool
        Try it again, without earlier findings.
    """
    address = int(device.handle.int_ptr)
    if address in _KNOWN and not (anew and _KNOWN[address].target is None):
        return _KNOWN[address]
    target = remedy_for(device.handle)
    subject = subject_of(device, target)
    verdict = None if anew else kept_verdict(subject)
    if verdict is None:
        why, lasting = try_in_child(device, target)
        verdict = Verdict(why, target)
        if lasting:
            keep_verdict(subject, verdict)
    _KNOWN[address] = verdict
    if verdict.works and target is not None:
        _repair(device, target)
    return verdict


def _repair(device: Device, target: str) -> None:
    partner = partner_of(device.handle)
    for handle in [device.handle] + ([] if partner is None else [partner]):
        rename_target(handle, target)
