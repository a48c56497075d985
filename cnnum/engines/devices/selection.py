"""Which device is used: the fastest that has shown that it works, or the one asked for."""

from typing import cast

from cnnum.engines.devices.inline import partner_of
from cnnum.engines.devices.listing import Device, list_devices
from cnnum.engines.devices.pocl_wheel import remedy_for, rename_target
from cnnum.engines.devices.self_test import try_in_child
from cnnum.engines.devices.verdicts import (
    Verdict,
    keep_verdict,
    kept_verdict,
    subject_of,
)
from cnnum.engines.notices import say_once
from cnnum.engines.opencl_advice import how_to_get_opencl
from cnnum.errors import DeviceError, NoOpenCLError

_KNOWN = dict[int, Verdict]()
"""Verdicts of this process, by the address of the device's record, which a repair changes."""


def choose_device(name: str | None) -> Device:
    """Return the device that promises most among those that work, ready for use.

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
    """Return the devices of that name, whether they work or not; the most promising comes first.

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
    return sorted(matching, key=lambda device: -device.promise)


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
