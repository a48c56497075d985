"""Templates and programs as on an analogue array: coarse weights and memories, noise, mismatch."""

from __future__ import annotations  # signatures that `help` shows as they are written

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats, Shape, finite, largest
from cnnum.embedded.formats import is_integer
from cnnum.engines.backend import Backend, Solve
from cnnum.engines.registry import first_that
from cnnum.errors import MethodError, NotSupportedError
from cnnum.graph.nodes import Transient
from cnnum.runs.request import ROLES, Ask, maps_by_role
from cnnum.runs.result import Result
from cnnum.safety.values import expect, is_real
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.boundary import halo_sources
from cnnum.templating.network import taps
from cnnum.templating.numbers import on_grid
from cnnum.templating.template import Template

MOST_BITS = 32
STREAMS = {"A": 0, "B": 1, "z": 2, "noise": 3, "A of cells": 4}
"""Random numbers of each part have a stream of their own, so that none shifts another's."""


@dataclass(frozen=True, slots=True)
class Chip:
    """Model of an analogue array and its limited accuracy, for `Engine.run` and `Engine.compile`.

    A number of b bits is a whole multiple of the full scale divided by 2^(b − 1) − 1. Weights are
    rounded relative to the largest of A, B and z. Inputs, the initial state and the output are
    rounded relative to `full_scale` and saturate there; a bias map has its own scale. Noise is
    added to the output before it is rounded.

    Each weight is multiplied by 1 + ε. For B and z, ε differs from cell to cell. For A, all cells
    share it in `Engine.run`, since most engines have no feedback that differs from cell to cell;
    in a program, `Engine("reference").compile(..., chip=...)`, each cell has its own. In a
    program, the full scale of a map is its largest value, and the noise is relative to it.

    ACE16k has weights of 8 bits and an accuracy of 7 to 8 bits: Rodríguez-Vázquez et al. 2004,
    "ACE16k: the third generation of mixed-signal SIMD-CNN ACE chips toward VSoCs", IEEE
    Transactions on Circuits and Systems I 51(5). The defaults follow it, except for noise and
    mismatch, which depend on the array at hand.

    Mismatch of τ, nonlinear multipliers, noise during the transient, leaking memories and
    temperature are not modelled. The state is not rounded during the transient, and its output
    function is that of the template. Fixed boundaries are exact.

    Attributes
    ----------
    weight_bits, state_bits : int
        2 to 32.
    noise : float
        Standard deviation of the noise of the output, in the unit of the output.
    mismatch : float
        Standard deviation of ε, as a share of the weight.
    seed : int
        Selects the mismatch, which is the same for a whole batch and for all templates of the
        same size. Noise is drawn for each map of a batch. All engines use the same random numbers.
    full_scale : float
        Largest magnitude of inputs, initial states and outputs, in their unit.

    Raises
    ------
    MethodError
        If a number is out of range.
    """

    weight_bits: int = 8
    state_bits: int = 8
    noise: float = 0.0
    mismatch: float = 0.0
    seed: int = 0
    full_scale: float = 1.0

    def __post_init__(self) -> None:
        for name in ("weight_bits", "state_bits"):
            _whole(name, getattr(self, name), 2, MOST_BITS)
        _whole("seed", self.seed, 0, None)
        for name in ("noise", "mismatch", "full_scale"):
            value = getattr(self, name)
            least = "above 0" if name == "full_scale" else "from 0 up"
            if not is_real(value) or value < 0.0 or (value == 0.0 and name == "full_scale"):
                raise MethodError(
                    f"'{name}' of a chip must be a number {least}, got {value!r:.60}."
                )

    def stored(self, values: ArrayLike) -> Floats:
        """Return values as a memory of the array stores them: saturated and rounded."""
        held = np.clip(np.asarray(values, dtype=np.float64), -self.full_scale, self.full_scale)
        return on_grid(held, self.full_scale, self.state_bits)

    def read(self, output: Floats) -> Floats:
        """Return an output as the array reads it out: with noise, saturated and rounded."""
        if self.noise:
            output = output + self.noise * self.drawn("noise", output.shape)
        return self.stored(output)

    def programmed(self, template: Template, *, shared: bool = True) -> Template:
        """Return the template with the weights that all cells share.

        Parameters
        ----------
        template : Template
        shared : bool
            Whether A gets one mismatch that all cells share; if false, A stays exact here.

        Raises
        ------
        NotSupportedError
            If the template has nonlinear or delayed couplings, or gains.
        """
        if not template.plain:
            raise NotSupportedError(
                "A chip needs linear couplings without delay that are constant in time: run "
                f"'{template.name}', which has others, without 'chip'."
            )
        parts = {"A": template.A, "B": template.B, "z": template.z}
        top = max(largest(part) for part in parts.values())
        parts = {key: on_grid(part, top, self.weight_bits) for key, part in parts.items()}
        if self.mismatch and shared:
            parts["A"] = parts["A"] * (1.0 + self.mismatch * self.drawn("A", parts["A"].shape))
        changes: dict[str, Any] = {"A": parts["A"], "z": parts["z"].tolist()}
        changes |= {"B": parts["B"]} if template.inputs else {}
        if not isinstance(template.initial, str):
            changes["initial"] = float(self.stored(template.initial))
        return replace(template, **changes)

    def offsets(self, template: Template, inputs: Floats | None, shape: Shape) -> Floats:
        """Return the bias that the mismatch of B and z adds, (..., layers, rows, cols).

        Parameters
        ----------
        template : Template
            The template as `programmed` returns it.
        inputs : (..., inputs, rows, cols) float or None
        shape : (rows, cols)
        """
        lead = () if inputs is None else inputs.shape[:-3]
        total = np.zeros((*lead, template.layers, *shape))
        total += template.z[:, np.newaxis, np.newaxis] * self.drawn("z", total.shape[-3:])
        if inputs is not None:
            off, radius = self.drawn("B", (*template.B.shape, *shape)), template.B.shape[-1] // 2
            halo = halo_sources(template.input_boundary, shape, radius)
            rim = np.full((*inputs.shape[:-2], 1), template.input_boundary.constant or 0.0)
            # virtual cells of a fixed boundary have the index −1: the last
            seen = np.concatenate([inputs.reshape(*inputs.shape[:-2], -1), rim], axis=-1)[..., halo]
            for layer in range(template.layers):
                for tap in taps(template.B, layer):
                    row, col = radius + tap.row, radius + tap.col
                    near = seen[..., tap.source, row : row + shape[0], col : col + shape[1]]
                    total[..., layer, :, :] += tap.weight * off[layer, tap.source, row, col] * near
        return self.mismatch * total

    def drawn(self, part: str, size: tuple[int, ...]) -> Floats:
        """Return the standard normal numbers of a part, the same for every call with that size."""
        return np.random.default_rng([self.seed, STREAMS[part]]).standard_normal(size)


def on_chip(ask: Ask, down: Callable[[Ask], Result]) -> Result:
    """Run a template as on an analogue array.

    Raises
    ------
    MethodError
        If `chip` is not a `Chip`.
    NotSupportedError
        If the template is a batch of them, or has couplings that no chip has.
    ArrayError
        If the arrays do not fit.
    """
    expect("chip", ask.chip, Chip, MethodError)
    assert ask.chip is not None
    chip = ask.chip
    template = ask.template
    if isinstance(template, TemplateBatch):
        raise NotSupportedError(
            "A chip stores one template at a time: run those of a batch one by one."
        )
    own = chip.programmed(template)
    names = ("input", "previous", "state", "bias", "mask")
    given, shape = maps_by_role(template, dict(zip(names, ask.arrays, strict=True)))
    maps = {role: finite(role, array) for role, array in given.items()}
    for role in maps.keys() & {*ROLES, "previous"}:
        maps[role] = chip.stored(maps[role])
    if "bias" in maps:
        maps["bias"] = on_grid(maps["bias"], largest(maps["bias"]), chip.state_bits)
    if chip.mismatch:
        offsets = chip.offsets(own, maps.get("input"), shape)
        maps["bias"] = offsets + maps["bias"] if "bias" in maps else offsets
    plain = {role: _plain(array) for role, array in maps.items()}
    result = down(ask.of(own, [plain.get(name) for name in names]))
    bits = f"chip of {chip.weight_bits}-bit weights and {chip.state_bits}-bit maps"
    return replace(result, output=chip.read(result.output), reason=f"{bits}; {result.reason}")


def _plain(array: Floats) -> Floats:
    """Return maps as a user gives them: a single one has no axis of its own."""
    return array[..., 0, :, :] if array.shape[-3] == 1 else array


def _whole(name: str, value: Any, least: int, most: int | None) -> None:
    # True and False are whole numbers to Python
    number = -1 if isinstance(value, bool) or not isinstance(value, Integral) else int(value)
    if number < least or (most is not None and number > most):
        upto = "up" if most is None else f"to {most}"
        raise MethodError(
            f"'{name}' of a chip must be a whole number from {least} {upto}, got {value!r:.60}."
        )


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
        held = {
            role: scaled(chip, values) if role in SCALED else values
            for role, values in maps.items()
        }
        feedback = None
        if chip.mismatch:
            off = chip.offsets(own, held.get("input"), shape)
            held["bias"] = off + held["bias"] if "bias" in held else off
            feedback = uneven_feedback(chip, own, shape)
        result = solve(replace(operation, template=own), held, feedback)
        output = result["output"]
        if chip.noise:
            random = np.random.default_rng([chip.seed, next(self.runs)])
            output = output + chip.noise * largest(output) * random.standard_normal(output.shape)
        return result | {"output": scaled(chip, output)}


def chip_backend(chip: Chip, backend: Backend) -> Backend:
    """Return the builder of programs on a chip.

    Raises
    ------
    MethodError
        If `chip` is not a `Chip`.
    NotSupportedError
        If the engine has cells that are all alike, or counts in whole numbers.
    """
    expect("chip", chip, Chip, MethodError)
    record = backend.record
    if record.analogue is None or is_integer(backend.precision):
        able = first_that(lambda candidate: candidate.analogue)
        raise NotSupportedError(
            f"Only Engine('{able.name}') runs programs on a chip, because the feedback may "
            f"differ from cell to cell; got the engine '{record.name}' in {backend.precision}."
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
