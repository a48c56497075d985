"""Listing of OpenCL platforms and devices.

CPU devices that run kernels in the calling thread are listed as partners.

A launch on the usual device of a processor wakes a thread of its pool. The pool wakes the host
again. That takes 20 to 60 µs on a virtual machine, more than the work of a small frame. Threads
cannot share such a frame anyway. PoCL has a second device for the same processor that does neither
("basic"; "cpu-minimal" from version 4 on). PoCL offers it only where it is asked for by name.

Intel's runtime for processors (the extra `intel`) is installed by pip in a folder that OpenCL
loaders do not search. For the first listing of platforms, the loader is given a folder that lists
it along with the platforms it would find anyway.
"""

import os
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from tempfile import TemporaryDirectory

import pyopencl as cl

from cnnum.engines.devices.pocl import given_a_folder
from cnnum.engines.forks import note_opencl, refuse_after_fork
from cnnum.engines.notices import how_to_get_opencl
from cnnum.errors import NoOpenCLError

VARIABLE = "POCL_DEVICES"
"""PoCL reads it once: 3.1 when its platform is listed first, 3.0 when its devices are. Names that
it does not know are passed over. A value of the user's own stands."""

KINDS = {"pthread-": "basic-", "cpu-": "cpu-minimal-"}
"""How the names of the two devices of a processor begin; the rest of the names is the same."""

VENDORS_VARIABLE = "OCL_ICD_VENDORS"
"""Folder in which the loader of pyopencl's wheel looks. A value of the user's own stands."""

USUAL_VENDORS = Path("/etc/OpenCL/vendors")
"""Folder in which loaders look on Linux unless that variable names another."""

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


def intel_runtime() -> Path | None:
    """Return the library of Intel's runtime, or None if pip has not installed it."""
    if sys.platform != "linux":
        return None
    try:
        files = distribution("intel-opencl-rt").files or []
    except PackageNotFoundError:
        return None
    places = (Path(str(file.locate())) for file in files if file.name == "libintelocl.so")
    return next((place.resolve() for place in places if place.exists()), None)


@contextmanager
def intel_offered() -> Generator[None]:
    """List platforms within the block: Intel's is among them."""
    library = None if VENDORS_VARIABLE in os.environ else intel_runtime()
    if library is None:
        yield
        return
    with TemporaryDirectory(prefix="cnnum-vendors-") as folder:
        for known in USUAL_VENDORS.glob("*.icd"):
            (Path(folder) / known.name).symlink_to(known)
        (Path(folder) / "intel-from-pip.icd").write_text(f"{library}\n")
        os.environ[VENDORS_VARIABLE] = folder
        try:
            yield
        finally:
            os.environ.pop(VENDORS_VARIABLE, None)


def partner_of(device: cl.Device) -> cl.Device | None:
    """Return the device that runs the same CPU's kernels in the calling thread."""
    name = str(device.name)
    wanted = [own + name[len(usual) :] for usual, own in KINDS.items() if name.startswith(usual)]
    result = (other for other in device.platform.get_devices() if str(other.name) in wanted)
    return next(result, None)


def without_partners(devices: list[cl.Device]) -> list[cl.Device]:
    """Return a platform's devices without those that only stand in for another of them."""
    partners = [partner_of(device) for device in devices]
    return [device for device in devices if device not in partners]


NONE = "no OpenCL platform has a device"

NEAR_BYTES = {"AuthenticAMD": 6 * 1024 * 1024 + 512 * 1024}
"""Cache of a core that keeps up with its arithmetic, by vendor. AMD's third level is that of a few
cores. Euler's steps of 3000×5000 cells take nine tenths of the time that they take with 4.4 MiB.
The fourth-order Runge–Kutta's of 1024×1024 take six sevenths of that with 1 MiB (EPYC)."""

SECOND_LEVEL = 512 * 1024
"""That of others: half of the second level of a server's core. Euler's steps of 1024×1024 cells
take 0.5 to 0.9 of their time with 4 MiB (Intel Xeon, Skylake, shared)."""


@dataclass(frozen=True, slots=True, eq=False)
class Device:
    """An OpenCL device with the figures that choose between devices."""

    platform: str
    platform_version: str
    name: str
    version: str
    driver: str
    kind: str
    units: int
    clock_mhz: int
    lanes: int
    double: bool
    handle: cl.Device

    @property
    def label(self) -> str:
        """Description of the device."""
        return f"{self.name} ({self.platform}, driver {self.driver})"

    @property
    def near_bytes(self) -> int:
        """Cache of a core that keeps up with its arithmetic."""
        return NEAR_BYTES.get(str(self.handle.vendor), SECOND_LEVEL)

    @property
    def promise(self) -> float:
        """Nominal operations per second: units · clock · lanes.

        A GPU's unit issues whole warps, which its vector width (1) does not say.
        """
        width = 64 if self.kind == "GPU" else self.lanes
        return float(self.units * max(self.clock_mhz, 1) * width)


def _describe(platform: cl.Platform, device: cl.Device) -> Device:
    return Device(
        platform=str(platform.name),
        platform_version=str(platform.version).strip(),
        name=str(device.name).strip(),
        version=str(device.version).strip(),
        driver=str(device.driver_version).strip(),
        kind="GPU" if device.type & cl.device_type.GPU else "CPU",
        units=int(device.max_compute_units),
        clock_mhz=int(device.max_clock_frequency),
        lanes=int(device.native_vector_width_float) or 1,
        double="cl_khr_fp64" in device.extensions,
        handle=device,
    )


def list_devices() -> tuple[Device, ...]:
    """Return all OpenCL devices of all platforms.

    Raises
    ------
    NoOpenCLError
        If there is none, and the sentence names the package to install; or none since a fork.
    """
    refuse_after_fork()
    note_opencl()
    try:
        with given_a_folder(), asked_for(), intel_offered():
            listed = [(platform, _devices_of(platform)) for platform in cl.get_platforms()]
    except cl.Error:
        raise NoOpenCLError(NONE, how_to_get_opencl()) from None
    result = tuple(_describe(platform, device) for platform, own in listed for device in own)
    if not result:
        raise NoOpenCLError(NONE, how_to_get_opencl())
    return result


def _devices_of(platform: cl.Platform) -> list[cl.Device]:
    try:
        return without_partners(list(platform.get_devices()))
    except cl.Error:  # a platform whose driver finds no hardware
        return []
