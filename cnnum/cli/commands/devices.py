"""`cnnum devices`: OpenCL devices, their speed, and which one is used."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from cnnum.cli.options import json_option
from cnnum.cli.output import Output, facts, progress

if TYPE_CHECKING:
    from cnnum.engines.devices.listing import Device
    from cnnum.engines.devices.peak import Figures
    from cnnum.engines.devices.selection import Verdict


TEMPLATES = ("EDGE", "DIFFUS", "HOLE", "LAPLACE", "SHADOW", "leaky_cell", "THRESHOLD")
"""Cells alone and in waves, exact and in steps, with weights of one and of both signs."""

SHAPES = ((8, 8), (40, 36))
"""In registers of one work item, and in tiles or in global memory."""


@dataclass(frozen=True, slots=True)
class Tested:
    """Answers of a device in one precision.

    Attributes
    ----------
    precision : str
    tests : int
    failed : tuple of str
        Template and shape of those that were wrong, with the error and its bound.
    """

    precision: str
    tests: int
    failed: tuple[str, ...]


def self_test(device: "Device") -> list[Tested]:
    """Run templates on a device that works, and compare the results with their closed forms."""
    precisions = ("float32", "float64") if device.double else ("float32",)
    return [_tested(device, precision) for precision in precisions]


def _tested(device: "Device", precision: str) -> Tested:
    from cnnum.engine import Engine
    from cnnum.errors import CnnumError
    from cnnum.templating.checks.running import run_check
    from cnnum.templating.library import get_template

    engine = Engine("opencl", device=device.label, precision=precision)
    failed = list[str]()
    for name in TEMPLATES:
        for shape in SHAPES:
            label = f"{name} on {shape[0]}×{shape[1]}"
            try:
                result = run_check(get_template(name), engine, shape=shape, repeats=0)
            except CnnumError as error:
                failed.append(f"{label}: {error}")
                continue
            if not result.passed:
                limit = f"{result.error:.3g}, at most {result.tolerance:g}"
                failed.append(f"{label}: off by {limit}")
    return Tested(precision, len(TEMPLATES) * len(SHAPES), tuple(failed))


@click.command("devices")
@click.option("--device", help="Part of the device's name, as for Engine(device=…).")
@click.option(
    "--measure/--no-measure", default=True, help="Time kernels, which takes seconds per device."
)
@click.option(
    "--self-test",
    "testing",
    is_flag=True,
    help="Compare the results of each device with known ones.",
)
@click.option("--arrays", is_flag=True, help="List serial ports and guess the arrays at them.")
@click.option("--port", "ports", multiple=True, help="Additional port to listen at, with --arrays.")
@json_option
def command(
    device: str | None,
    measure: bool,
    testing: bool,
    arrays: bool,
    ports: tuple[str, ...],
    as_json: bool,
) -> None:
    """List the OpenCL devices, test and measure each, and show which one would be used.

    Each device is first tried in a separate process. One that does not work is listed as broken,
    with the reason.

    The peak counts a single-precision multiply-add as two operations and is that of the best of
    several kernels. The bandwidth counts the bytes that a copy reads and writes. Both are the
    best of several runs, and lower on a busy machine.

    With --self-test nothing is measured. Instead, each device runs templates with known results
    in each of its precisions, and a wrong result ends the command with exit code 1.

    With --arrays it lists serial ports instead and listens for a moment at each. It names the
    protocol that fits the bytes it hears. Nothing is written to a port.
    """
    if arrays:
        _arrays(ports, as_json=as_json)
        return
    from cnnum.engines.registry import open_backend
    from cnnum.errors import NoOpenCLError

    output = Output(as_json)
    try:
        tried = _tried(device, measure=measure and not testing, as_json=as_json)
    except (NoOpenCLError, ImportError):  # without PyOpenCL there is no list of devices either
        tried = []
    used = next((result for result in tried if result.why), None)
    wrong = False
    for result in tried:
        output.record(_record(result))
        output.show(facts(_facts(result)), "")
        if testing:
            wrong |= not _passes(result, output)
    if used is None:
        # it says why, or raises where a device was asked for by its name
        host = open_backend(None, device, None)
        why = "no OpenCL device works"
        output.record(
            {"engine": host.record.name, "device": host.device, "chosen": True, "why": why}
        )
        output.show(
            facts([("CPU", host.device), ("used", f"yes, by the {host.record.name} engine: {why}")])
        )

    if wrong:
        raise SystemExit(1)


def _passes(tried: "_Tried", output: Output) -> bool:
    """Show how a device does in its self-test; one that does not work at all has failed it."""
    from cnnum.cli.commands.devices import self_test

    if not tried.verdict.works:
        return False
    tested = self_test(tried.device)
    for suite in tested:
        record = {"device": tried.device.name, "precision": suite.precision, "tests": suite.tests}
        output.record({**record, "failed": list(suite.failed), "passed": not suite.failed})
        said = f"all {suite.tests} known answers" if not suite.failed else "; ".join(suite.failed)
        output.show(facts([(suite.precision, said)]), "")
    return not any(suite.failed for suite in tested)


def _arrays(ports: tuple[str, ...], *, as_json: bool) -> None:
    """Show serial ports with a guess, and the protocols that are known."""
    from cnnum.drivers.codecs.wire import protocol_names
    from cnnum.drivers.serial_port import guesses, serial_ports

    output = Output(as_json)
    for guess in guesses(ports, serial_ports()):
        port = guess.port
        said = f"{guess.protocol}, {guess.baud} baud: {guess.said}" if guess.baud else guess.said
        record = {"kind": "array", "port": port.path, "about": port.about, "usb": port.usb}
        output.record(
            {**record, "protocol": guess.protocol, "baud": guess.baud, "said": guess.said},
            f"{' '.join(filter(None, (port.path, port.about, port.usb)))}\n    {said}",
        )
    output.show(facts([("protocols", ", ".join(protocol_names()))]))


@dataclass(frozen=True, slots=True)
class _Tried:
    """An OpenCL device and its figures.

    Attributes
    ----------
    device : Device
    verdict : Verdict
    figures : Figures or None
        None where it was not measured.
    why : str
        Why it is the one that is used; empty where it is not.
    """

    device: "Device"
    verdict: "Verdict"
    figures: "Figures | None"
    why: str


def _tried(wanted: str | None, *, measure: bool, as_json: bool) -> list[_Tried]:
    """Try every device anew, without earlier findings; measure those that work."""
    from cnnum.engines.devices.listing import list_devices
    from cnnum.engines.devices.peak import measure as measured
    from cnnum.engines.devices.selection import devices_named, verdict_on

    listed, named, tried = list_devices(), devices_named(wanted), list[_Tried]()
    with progress("devices", len(listed), as_json=as_json) as steps:
        verdicts = {known.label: verdict_on(known, anew=True) for known in listed}
        working = [device for device in named if verdicts[device.label].works]
        for known in listed:
            verdict = verdicts[known.label]
            is_used = bool(working) and known.handle == working[0].handle
            why = _why(known, listed, verdicts, wanted) if is_used else ""
            figures = measured(known) if measure and verdict.works else None
            tried.append(_Tried(known, verdict, figures, why))
            steps.advance()
    return tried


def _why(
    chosen: "Device",
    listed: "Sequence[Device]",
    verdicts: "Mapping[str, Verdict]",
    wanted: str | None,
) -> str:
    promise = f"{chosen.units} units × {chosen.clock_mhz} MHz × vectors of {chosen.lanes}"
    working = [device for device in listed if verdicts[device.label].works]
    if len(listed) == 1:
        return "the only device"
    if len(working) == 1:
        return "the only device that works"
    if wanted is not None:
        return f"its name contains '{wanted}'"
    alike = [device for device in working if device.kind == chosen.kind]
    if len(alike) == 1 and chosen.kind == "CPU":
        return "the only processor; a GPU is used when it is asked for by name"
    ties = [d for d in alike if d is not chosen and d.promise == chosen.promise]
    more = ", and it is listed first of those that promise as much" if ties else ""
    return f"it promises most: {promise}{more}"


def _record(tried: _Tried) -> dict[str, object]:
    device, figures = tried.device, tried.figures
    record: dict[str, object] = {
        "platform": device.platform,
        "device": device.name,
        "version": device.version,
        "kind": device.kind,
        "units": device.units,
        "clock_mhz": device.clock_mhz,
        "lanes": device.lanes,
        "double": device.double,
        "works": tried.verdict.works,
        "broken": tried.verdict.why,
        "repaired": tried.verdict.target or "",
        "chosen": bool(tried.why),
        "why": tried.why,
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


def _facts(tried: _Tried) -> list[tuple[str, str]]:
    device, figures, verdict = tried.device, tried.figures, tried.verdict
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
    if not verdict.works:
        return [*pairs, ("broken", verdict.why), ("used", "no: it does not work")]
    if verdict.target is not None:
        text = f"its compiler does not know this processor, and takes it for '{verdict.target}'"
        pairs.append(("repaired", text))
    return [*pairs, ("used", f"yes: {tried.why}" if tried.why else "no")]
