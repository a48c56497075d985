"""Whole programs as on an analogue array: every template of a frame runs with the chip's limits."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count

import numpy as np

from cnnum.arrays import Floats, Shape, largest
from cnnum.embedded.formats import is_integer
from cnnum.engines.backend import Backend, Solve
from cnnum.engines.registry import first_that
from cnnum.errors import MethodError, NotSupportedError
from cnnum.graph.nodes import Transient
from cnnum.runs.chip import Chip
from cnnum.safety.values import expect
from cnnum.templating.boundary import halo_sources
from cnnum.templating.network import taps
from cnnum.templating.numbers import on_grid
from cnnum.templating.template import Template

SCALED = ("input", "previous", "state", "bias")


@dataclass(frozen=True, slots=True, eq=False)
class ChipModel:
    """Runs the templates of a program as on an analogue array.

    Attributes
    ----------
    chip : Chip
    runs : iterator of int
        Counts the templates that were run: each has noise of its own.
    """

    chip: Chip
    runs: Iterator[int] = field(default_factory=count)

    def refuse(self, template: Template) -> None:
        """Raise if a template has couplings that no chip has."""
        self.chip.programmed(template)

    def answer(
        self, solve: Solve, operation: Transient, maps: dict[str, Floats], shape: Shape
    ) -> dict[str, Floats]:
        """Return the answers of a template's run on one frame."""
        chip, template = self.chip, operation.template
        # a start that all cells share is a level of the chip's own
        own = replace(chip.programmed(template, shared=False), initial=template.initial)
        held = {role: scaled(chip, each) if role in SCALED else each for role, each in maps.items()}
        feedback = None
        if chip.mismatch:
            off = chip.offsets(own, held.get("input"), shape)
            held["bias"] = off + held["bias"] if "bias" in held else off
            feedback = uneven_feedback(chip, own, shape)
        found = solve(replace(operation, template=own), held, feedback)
        output = found["output"]
        if chip.noise:
            random = np.random.default_rng([chip.seed, next(self.runs)])
            output = output + chip.noise * largest(output) * random.standard_normal(output.shape)
        return found | {"output": scaled(chip, output)}


def chip_backend(chip: Chip, backend: Backend) -> Backend:
    """Return the builder of programs on a chip.

    Raises
    ------
    MethodError
        If it is no chip.
    NotSupportedError
        If the engine has cells that are all alike, or counts in whole numbers.
    """
    expect("chip", chip, Chip, MethodError)
    record = backend.record
    if record.analogue is None or is_integer(backend.precision):
        able = first_that(lambda one: one.analogue)
        raise NotSupportedError(
            f"A program runs on a chip by Engine('{able.name}'): its feedback may differ from cell "
            f"to cell. Got the engine '{record.name}' in {backend.precision}."
        )
    return record.analogue(record, partial(ChipModel, chip))


def scaled(chip: Chip, values: Floats) -> Floats:
    """Return maps as a memory holds them whose gain fits their largest magnitude."""
    return on_grid(values, largest(values), chip.state_bits)


def uneven_feedback(chip: Chip, template: Template, shape: Shape) -> Callable[[Floats], Floats]:
    """Return the sum of A over outputs with weights of its own in every cell.

    Parameters
    ----------
    chip : Chip
    template : Template
        The programmed one.
    shape : (rows, cols)

    Returns
    -------
    callable
        Takes outputs, (layers, rows, cols), to their sum in the rates.
    """
    radius, edge = template.A.shape[-1] // 2, template.boundary.constant
    halo = halo_sources(template.boundary, shape, radius)
    seen = 0.0 if edge is None else float(template.output.numpy(np.asarray(edge)))
    rim = np.full((template.layers, 1), seen)
    off = 1.0 + chip.mismatch * chip.drawn("A of cells", (*template.A.shape, *shape))
    weights = [
        (layer, tap.source, radius + tap.row, radius + tap.col, tap.weight)
        for layer in range(template.layers)
        for tap in taps(template.A, layer)
    ]

    def through(outputs: Floats) -> Floats:
        # virtual cells of a fixed boundary have the index −1: the last
        flat = np.concatenate([outputs.reshape(template.layers, -1), rim], axis=-1)
        near, total = flat[..., halo], np.zeros_like(outputs)
        for layer, source, row, col, weight in weights:
            cells = near[source, row : row + shape[0], col : col + shape[1]]
            total[layer] += weight * off[layer, source, row, col] * cells
        return total

    return through
