"""The place and tools of a measurement: without them a number says little."""

import os
import platform
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version

from cnnum.engines.notices import processor
from cnnum.version import __version__

_PACKAGES = ("numpy", "scipy", "pyopencl", "pocl-binary-distribution")


@dataclass(frozen=True, slots=True)
class Environment:
    """A machine, its compute device, the versions and the date.

    Attributes
    ----------
    date : str
        ISO 8601, UTC.
    machine : str
        Processor and number of cores that may be used.
    system : str
    device : str
        The device of the programs.
    versions : tuple of (str, str)
        cnnum, Python and the packages that compute.
    """

    date: str
    machine: str
    system: str
    device: str
    versions: tuple[tuple[str, str], ...]

    @classmethod
    def here(cls, device: str) -> "Environment":
        """Return this machine, now.

        Parameters
        ----------
        device : str
            Name that an engine gives to its device.
        """
        result = (("cnnum", __version__), ("Python", platform.python_version()))
        packages = ((name, _version(name)) for name in _PACKAGES)
        return cls(
            date=datetime.now(UTC).isoformat(timespec="seconds"),
            machine=f"{processor().name}, {_cores()} cores",
            system=f"{platform.system()} {platform.machine()}",
            device=device,
            versions=(*result, *((name, number) for name, number in packages if number)),
        )


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def _cores() -> int:
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1
