"""Verdicts on devices, kept from one process to the next: a device shows only once that it works.

A verdict holds for one driver, device, processor and version of the packages. It is a small entry
of the cache; where none can be kept, every process tries its device anew.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import cast

from cnnum.engines.cache import Shelf
from cnnum.engines.devices.listing import Device
from cnnum.engines.processor import processor
from cnnum.version import __version__

SHELF = Shelf("verdicts")

PACKAGES = ("pyopencl", "pocl-binary-distribution")


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a device works.

    Attributes
    ----------
    why : str
        Why it does not; empty where it does.
    target : str or None
        Name that its processor is given first (`pocl_wheel.py`); None where it needs none.
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
    """Return the verdict that was kept; None where there is none, or none that can be read."""
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
