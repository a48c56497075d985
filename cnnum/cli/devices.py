"""`cnnum devices`: OpenCL devices, what they reach, and which one is used."""

from typing import TYPE_CHECKING

import click

from cnnum.cli.options import json_option
from cnnum.cli.output import Output, facts
from cnnum.cli.progress import progress

if TYPE_CHECKING:
    from cnnum.engines.opencl.devices import Device
    from cnnum.engines.opencl.measure import Figures


@click.command("devices")
@click.option("--device", help="Part of the device's name: as for Engine(device=…).")
@click.option("--measure/--no-measure", default=True, help="Time kernels (seconds a device).")
@json_option
def command(device: str | None, measure: bool, as_json: bool) -> None:
    """Show OpenCL platforms and devices, measure each, and say which one would be used.

    The peak counts a single-precision multiply-add as two operations and is that of the best of
    several kernels; the bandwidth counts bytes read and written by a copy. Both are the best of
    several runs just now: a busy machine shows less.
    """
    from cnnum.engines.opencl.devices import choose_device, list_devices
    from cnnum.engines.opencl.measure import measure as measured

    output, found = Output(as_json), list_devices()
    chosen = choose_device(device).handle
    results: list[tuple[Device, Figures | None]] = []
    with progress("devices", len(found), as_json=as_json) as steps:
        for known in found:
            results.append((known, measured(known) if measure else None))
            steps.advance()
    for known, figures in results:
        is_chosen = known.handle == chosen
        why = _why(known, found, device) if is_chosen else ""
        output.record(_record(known, figures, why))
        output.show(facts(_facts(known, figures, why)), "")


def _why(chosen: "Device", found: "tuple[Device, ...]", asked: str | None) -> str:
    promise = f"{chosen.units} units × {chosen.clock_mhz} MHz × vectors of {chosen.lanes}"
    if len(found) == 1:
        return "the only device"
    if asked is not None:
        return f"its name contains '{asked}'"
    ties = [d for d in found if d is not chosen and d.promise == chosen.promise]
    more = ", and it is listed first of those that promise as much" if ties else ""
    return f"it promises most: {promise}{more}"


def _record(device: "Device", figures: "Figures | None", why: str) -> dict[str, object]:
    record: dict[str, object] = {
        "platform": device.platform,
        "device": device.name,
        "version": device.version,
        "kind": device.kind,
        "units": device.units,
        "clock_mhz": device.clock_mhz,
        "lanes": device.lanes,
        "double": device.double,
        "chosen": bool(why),
        "why": why,
    }
    if figures is not None:
        record |= {
            "peak_gflops": round(figures.flops / 1e9, 2),
            "bandwidth_gbs": round(figures.bandwidth / 1e9, 2),
            "kernel": figures.kernel,
            "kernels": figures.kernels,
            "failed": figures.failed,
            "seconds": round(figures.seconds, 3),
        }
    return record


def _facts(device: "Device", figures: "Figures | None", why: str) -> list[tuple[str, str]]:
    pairs = [
        (device.kind, device.name),
        ("platform", device.platform),
        ("version", device.version),
        (
            "size",
            f"{device.units} units, {device.clock_mhz} MHz, vectors of {device.lanes}, "
            f"{'with' if device.double else 'without'} float64",
        ),
    ]
    if figures is not None:
        pairs += [
            (
                "peak",
                f"{figures.flops / 1e9:.0f} GFLOP/s, multiply-adds of float32 "
                f"({figures.kernel}; the best of {figures.kernels})",
            ),
            ("bandwidth", f"{figures.bandwidth / 1e9:.1f} GB/s, read and written by a copy"),
        ]
        if figures.failed:
            pairs.append(("note", f"its compiler gave up on the kernel '{figures.failed}'"))
    return [*pairs, ("used", f"yes: {why}" if why else "no")]
