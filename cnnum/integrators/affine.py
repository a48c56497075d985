"""Linear operations on maps: the exact answers of templates, and sums of maps.

An affine map of a program's values is kept as one matrix for each value that it reads. The constant
is a map. A linear template without time steps takes such maps to such maps.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.graph.elementwise import ADD, DIVIDE, MULTIPLY, NEGATE, SUBTRACT, SUM
from cnnum.graph.nodes import Apply, Constant, ConstantMap, Node, Pick, Reduce, Transient
from cnnum.integrators.solver import Linear, Scheme
from cnnum.templating.boundary import Boundary
from cnnum.templating.network import taps
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True, eq=False)
class Affine:
    """Σ matrix · source + constant, of a map with its cells row-major.

    Attributes
    ----------
    parts : dict of int to (cells, cells) float
        The matrix of each source, by the source's number.
    constant : (cells,) float
    """

    parts: dict[int, Floats]
    constant: Floats

    @classmethod
    def source(cls, number: int, cells: int) -> "Affine":
        """Return a source itself."""
        return cls({number: np.eye(cells)}, np.zeros(cells))

    def of(self, number: int) -> Floats:
        """Return the matrix of a source; zeros of one that is not read."""
        n = self.constant.size
        return self.parts.get(number, np.zeros((n, n)))


def is_linear(operation: Transient, scheme: Scheme, asked: Sequence[Pick]) -> bool:
    """Whether the wanted result of a transient is an affine map of inputs, states and biases.

    A cell that may leave the linear range of its output is not linear, however its input may be:
    uncoupled cells are, as their states never see the output.
    """
    if not isinstance(scheme, Linear):
        return False
    if not operation.template.plain or operation.has_mask or operation.has_previous:
        return False
    maps = {"state", "output"} if operation.template.output.linear else {"state"}
    return all(pick.what in maps for pick in asked)


def local(node: Node, arguments: Sequence[Affine], cells: int) -> Affine:
    """Return a sum, a difference, a multiple or the total of affine maps."""
    operation = node.operation
    if isinstance(operation, Constant):
        return Affine({}, np.full(cells, operation.value))
    if isinstance(operation, ConstantMap):
        return Affine({}, operation.values.ravel())
    if isinstance(operation, Reduce):
        return _each(arguments, _total)
    assert isinstance(operation, Apply)
    if operation.function is MULTIPLY:
        fixed, moved = sorted(arguments, key=lambda a: bool(a.parts))
        return _scaled(moved, fixed.constant)
    if operation.function is DIVIDE:
        return _scaled(arguments[0], 1.0 / arguments[1].constant)
    return _each(arguments, lambda *of: operation.function.numpy(*of))


LINEAR = (ADD, SUBTRACT, NEGATE)
"""Local operations that are linear in all they read."""


def is_affine(node: Node, fixed: Sequence[bool]) -> bool:
    """Whether a local operation is linear in its arguments, where some is always the same."""
    operation = node.operation
    if isinstance(operation, Reduce):
        return operation.function is SUM and not node.arguments[0].scalar
    if not isinstance(operation, Apply):
        return isinstance(operation, Constant | ConstantMap)
    if operation.function is MULTIPLY:
        return any(fixed)
    if operation.function is DIVIDE:
        by = node.arguments[1].operation
        return isinstance(by, Constant) and by.value != 0.0
    return operation.function in LINEAR


def _total(value: Floats) -> Floats:
    return np.broadcast_to(value.sum(axis=0), value.shape)


def _each(arguments: Sequence[Affine], function: Callable[..., Floats]) -> Affine:
    numbers = dict.fromkeys(number for a in arguments for number in a.parts)
    parts = {number: np.asarray(function(*(a.of(number) for a in arguments))) for number in numbers}
    return Affine(parts, np.asarray(function(*(a.constant for a in arguments))))


def _scaled(value: Affine, by: Floats) -> Affine:
    parts = {number: part * by[:, np.newaxis] for number, part in value.parts.items()}
    return Affine(parts, value.constant * by)


def states(
    operation: Transient, scheme: Scheme, arguments: Sequence[Affine], shape: Shape
) -> tuple[Affine, ...]:
    """Return the states of a linear template at its end, one a layer, of affine arguments."""
    assert isinstance(scheme, Linear)
    template, cells = operation.template, shape[0] * shape[1]
    numbers = list(dict.fromkeys(number for a in arguments for number in a.parts))
    # every column of every matrix is a map of its own
    columns = _Given.of(operation, [_columns(a, numbers) for a in arguments], shape)
    moved = _run(template, scheme.still(), columns, shape, still=False)
    constants = [a.constant[np.newaxis] for a in arguments]
    added = _run(template, scheme, _Given.of(operation, constants, shape), shape, still=True)
    found: list[Affine] = []
    for layer in range(template.layers):
        by_source = moved[:, layer].reshape(-1, cells, cells)
        parts = {number: by_source[place].T for place, number in enumerate(numbers)}
        found.append(Affine(parts, added[0, layer].ravel()))
    return tuple(found)


def _columns(value: Affine, numbers: Sequence[int]) -> Floats:
    cells = value.constant.size
    return np.concatenate([np.zeros((0, cells)), *(value.of(number).T for number in numbers)])


@dataclass(frozen=True, slots=True, eq=False)
class _Given:
    """Maps that a template is run on, (batch, maps, rows, cols) by role."""

    batch: int
    roles: dict[str, Floats]

    @classmethod
    def of(cls, operation: Transient, arguments: Sequence[Floats], shape: Shape) -> "_Given":
        roles = {
            role: np.stack(maps, axis=1).reshape(-1, len(maps), *shape)
            for role, maps in operation.by_role(arguments).items()
            if maps
        }
        return cls(len(arguments[0]) if arguments else 1, roles)


def _run(
    template: Template,
    scheme: Linear,
    given: _Given,
    shape: Shape,
    *,
    still: bool,
) -> Floats:
    """Return the states of a batch; constant parts count where `still`."""
    drive = np.zeros((given.batch, template.layers, *shape))
    if "input" in given.roles:
        _add_control(drive, template, given.roles["input"], still=still)
    drive += given.roles.get("bias", 0.0)
    if still:
        drive += template.z[:, np.newaxis, np.newaxis]
    start = _start(template, given.roles, drive.shape, still=still)
    return scheme.reach(start, drive)


def _start(
    template: Template, roles: dict[str, Floats], shape: tuple[int, ...], *, still: bool
) -> Floats:
    if "state" in roles:
        return roles["state"]
    if template.initial == "input":
        return roles["input"]
    return np.full(shape, float(template.initial) if still else 0.0)


def _add_control(drive: Floats, template: Template, maps: Floats, *, still: bool) -> None:
    """Add B∗u."""
    boundary, (rows, cols) = template.input_boundary, drive.shape[-2:]
    radius = template.B.shape[-1] // 2
    padded = _padded(maps, boundary, radius, still=still)
    # the batch lies last: sums of many maps run over neighbours in memory, in a third of the time
    padded = np.moveaxis(padded, 0, -1).copy()
    total, part = (np.zeros((rows, cols, len(drive))) for _ in range(2))
    for layer in range(template.layers):
        total[:] = np.moveaxis(drive[:, layer], 0, -1)
        for tap in taps(template.B, layer):
            top, left = radius + tap.row, radius + tap.col
            seen = padded[tap.source, top : top + rows, left : left + cols]
            total += np.multiply(tap.weight, seen, out=part)
        drive[:, layer] = np.moveaxis(total, -1, 0)


def _padded(maps: Floats, boundary: Boundary, radius: int, *, still: bool) -> Floats:
    width = ((0, 0), (0, 0), (radius, radius), (radius, radius))
    if boundary.pad_mode == "constant":
        edge = float(boundary.constant or 0.0) if still else 0.0
        return np.pad(maps, width, mode="constant", constant_values=edge)
    return np.pad(maps, width, mode=boundary.pad_mode)
