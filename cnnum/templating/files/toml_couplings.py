"""The tables [[nonlinear]], [[gain]] and [delayed] of a TOML template."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numpy as np

from cnnum.arrays import Floats, finite, frozen
from cnnum.errors import ArrayError, TemplateError
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.files.toml_values import (
    flag,
    matrix,
    number,
    points,
    table,
    text,
    whole,
    wrong,
)
from cnnum.templating.function_tables import Table
from cnnum.templating.template import Template

Reader = Callable[[str, str, object], Any]
T = TypeVar("T")

_FUNCTION: Mapping[str, Reader] = {"interpolation": text, "points": points}
_NONLINEAR: Mapping[str, Reader] = {
    "neighbour": text,
    "weights": matrix,
    **_FUNCTION,
    "centre": text,
    "to": whole,
    "source": whole,
    "centre_source": whole,
    "times_argument": flag,
    "reversed_sign": flag,
}
_GAIN: Mapping[str, Reader] = {"to": whole, "source": whole, **_FUNCTION}
_DELAYED: Mapping[str, Reader] = {"delay": number, "A": matrix, "B": matrix}


@dataclass(frozen=True, slots=True, eq=False)
class Delay:
    """The table [delayed]; missing kernels are zero, of a size that the template knows."""

    delay: float
    A: Floats | None
    B: Floats | None

    def coupling(self, template: Template) -> DelayedCoupling:
        """Return the delayed coupling of a template with those layers and inputs.

        Raises
        ------
        TemplateError
            If the delay is not positive.
        """
        layers, inputs = template.layers, template.inputs
        feedback = _zeros(layers, layers) if self.A is None else self.A
        control = _zeros(layers, inputs) if self.B is None else self.B
        return DelayedCoupling(self.delay, feedback, control)


def nonlinear(file: str, key: str, value: object) -> tuple[NonlinearCoupling, ...]:
    """Return the nonlinear couplings that the tables [[nonlinear]] describe.

    Raises
    ------
    TemplateError
        If a table misses a key, has an unknown one, or a value is wrong.
    """
    needed = ("neighbour", "weights", *_FUNCTION)

    def one(parts: dict[str, Any]) -> NonlinearCoupling:
        return NonlinearCoupling(function=_function(parts), **parts)

    return _several(file, key, value, _NONLINEAR, needed, one)


def gains(file: str, key: str, value: object) -> tuple[Gain, ...]:
    """Return the gains in time that the tables [[gain]] describe.

    Raises
    ------
    TemplateError
        As `nonlinear`.
    """

    def one(parts: dict[str, Any]) -> Gain:
        return Gain(parts.get("to", 0), parts.get("source", 0), _function(parts))

    return _several(file, key, value, _GAIN, tuple(_FUNCTION), one)


def delayed(file: str, key: str, value: object) -> Delay:
    """Return the values of the table [delayed].

    Raises
    ------
    TemplateError
        As `nonlinear`.
    """

    def one(parts: dict[str, Any]) -> Delay:
        return Delay(parts["delay"], _kernels(parts.get("A")), _kernels(parts.get("B")))

    return _one(file, key, value, _DELAYED, ("delay",), one)


def _several(
    file: str,
    key: str,
    value: object,
    readers: Mapping[str, Reader],
    needed: tuple[str, ...],
    make: Callable[[dict[str, Any]], T],
) -> tuple[T, ...]:
    if not isinstance(value, list):
        raise wrong(file, key, f"a list of tables [[{key}]]", value)
    items = enumerate(cast("list[object]", value))
    return tuple(_one(file, f"{key}[{n}]", item, readers, needed, make) for n, item in items)


def _one(
    file: str,
    key: str,
    value: object,
    readers: Mapping[str, Reader],
    needed: tuple[str, ...],
    make: Callable[[dict[str, Any]], T],
) -> T:
    found = table(file, key, value)
    for name in found:
        if name not in readers:
            raise TemplateError(
                f"'{file}': unknown key {f'{key}.{name}'!r:.60}, expected one of "
                f"{', '.join(readers)}."
            )
    for name in needed:
        if name not in found:
            raise TemplateError(f"'{file}': the key '{key}.{name}' is missing.")
    parts = {name: readers[name](file, f"{key}.{name}", item) for name, item in found.items()}
    try:
        return make(parts)
    except (TemplateError, ArrayError) as error:
        raise TemplateError(f"'{file}': the table '{key}' is wrong: {error}") from None


def _function(parts: dict[str, Any]) -> Table:
    return Table.of(parts.pop("interpolation"), parts.pop("points"))


def _kernels(rows: list[object] | None) -> Floats | None:
    if rows is None:
        return None
    kernels = finite("delayed weights", cast("list[float]", rows))
    kernels = kernels if kernels.ndim == 4 else kernels[np.newaxis, np.newaxis]
    if kernels.shape[-1] != kernels.shape[-2] or kernels.shape[-1] % 2 == 0:
        raise TemplateError(f"Delayed A and B must be (k, k) with k odd, got {kernels.shape[-2:]}.")
    return frozen(kernels)


def _zeros(to: int, source: int) -> Floats:
    return frozen(np.zeros((to, source, 1, 1)))
