"""The tables [[nonlinear]], [[gain]] and [delayed] of a TOML template."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, cast

import numpy as np

from cnnum.arrays import Floats, finite, frozen
from cnnum.errors import ArrayError, TemplateError
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.files.toml_values import (
    flag,
    matrix,
    number,
    points,
    refuse_unknown,
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


@dataclass(frozen=True, slots=True)
class _Tables(Generic[T]):
    """Tables of one kind: a reader for every key, the needed keys, and the coupling they make."""

    readers: Mapping[str, Reader]
    needed: tuple[str, ...]
    make: Callable[[dict[str, Any]], T]

    def several(self, file: str, key: str, value: object) -> tuple[T, ...]:
        """Return the couplings of a list of tables."""
        if not isinstance(value, list):
            raise wrong(file, key, f"a list of tables [[{key}]]", value)
        items = enumerate(cast("list[object]", value))
        return tuple(self.one(file, f"{key}[{n}]", item) for n, item in items)

    def one(self, file: str, key: str, value: object) -> T:
        """Return the coupling of a table."""
        found = table(file, key, value)
        refuse_unknown(file, found, self.readers, f"{key}.")
        for name in self.needed:
            if name not in found:
                raise TemplateError(f"'{file}': the key '{key}.{name}' is missing.")
        parts = {name: self.readers[name](file, f"{key}.{name}", found[name]) for name in found}
        try:
            return self.make(parts)
        except (TemplateError, ArrayError) as error:
            raise TemplateError(f"'{file}': the table '{key}' is wrong: {error}") from None


def nonlinear(file: str, key: str, value: object) -> tuple[NonlinearCoupling, ...]:
    """Return the nonlinear couplings that the tables [[nonlinear]] describe.

    Raises
    ------
    TemplateError
        If a table misses a key, has an unknown one, or a value is wrong.
    """

    def one(parts: dict[str, Any]) -> NonlinearCoupling:
        return NonlinearCoupling(function=_function(parts), **parts)

    needed = ("neighbour", "weights", *_FUNCTION)
    return _Tables(_NONLINEAR, needed, one).several(file, key, value)


def gains(file: str, key: str, value: object) -> tuple[Gain, ...]:
    """Return the gains in time that the tables [[gain]] describe; raises as `nonlinear`."""

    def one(parts: dict[str, Any]) -> Gain:
        return Gain(parts.get("to", 0), parts.get("source", 0), _function(parts))

    return _Tables(_GAIN, tuple(_FUNCTION), one).several(file, key, value)


def delayed(file: str, key: str, value: object) -> Delay:
    """Return the values of the table [delayed]; raises as `nonlinear`."""

    def one(parts: dict[str, Any]) -> Delay:
        return Delay(parts["delay"], _kernels(parts.get("A")), _kernels(parts.get("B")))

    return _Tables(_DELAYED, ("delay",), one).one(file, key, value)


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
