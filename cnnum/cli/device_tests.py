"""Known answers that a device must give: templates with a closed form, in each precision."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cnnum.engines.devices.listing import Device

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
    from cnnum.templating.checks.run import run_check
    from cnnum.templating.library import get_template

    engine = Engine("opencl", device=device.label, precision=precision)
    failed = list[str]()
    for name in TEMPLATES:
        for shape in SHAPES:
            about = f"{name} on {shape[0]}×{shape[1]}"
            try:
                result = run_check(get_template(name), engine, shape=shape, repeats=0)
            except CnnumError as error:
                failed.append(f"{about}: {error}")
                continue
            if not result.passed:
                limit = f"{result.error:.3g}, at most {result.tolerance:g}"
                failed.append(f"{about}: off by {limit}")
    return Tested(precision, len(TEMPLATES) * len(SHAPES), tuple(failed))
