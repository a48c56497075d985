"""Experiments: a template, the axes along which it is changed, and how each run is judged.

A run is a place on the axes, and knows its own random numbers: no order of runs changes it.
"""

import itertools
import math
import operator
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from os import PathLike
from pathlib import Path
from typing import Any, cast

import numpy as np

from cnnum.arrays import digest
from cnnum.embedded.formats import is_integer, precision_named
from cnnum.engines.registry import PRECISIONS, backend_names
from cnnum.errors import TemplateError, name_error
from cnnum.integrators.schemes import DECISION, WAVEFRONT
from cnnum.integrators.stability import METHODS
from cnnum.runs.chip import MOST_BITS
from cnnum.safety.values import is_real
from cnnum.templating.boundary import parse_boundary
from cnnum.templating.checks.registry import form_of
from cnnum.templating.files import toml_values as toml
from cnnum.templating.library import get_template
from cnnum.templating.template import Duration, Template

Value = float | str

OUTER = ("boundary", "size", "precision", "method", "tau")
"""Axes along which runs are launches of their own."""

COARSE = ("weight_bits", "chip_mismatch")
"""Axes of a chip's weights, which are those of linear couplings."""

CHIP = (*COARSE, "state_bits", "chip_noise", "chip_seed")
"""Axes of `cnnum.Chip`."""

INNER = ("noise", "mismatch", "offset", "drift", "bits", *CHIP, "z", "A", "B")
"""Axes whose runs can share a launch; so can single weights, as in "A[0, 1]"."""

BITS = ("bits", "weight_bits", "state_bits")
"""Axes of whole numbers."""

WIDTHS = ("noise", "mismatch", "offset", "drift", "chip_noise", "chip_mismatch")
"""Axes of standard deviations."""

WEIGHT = re.compile(r"[AB]\[\d+, ?\d+\]")
WORDS = ("precision", "method", "boundary")
"""Axes of names; a boundary may be a number, too."""

RUN_METHODS = ("auto", "propagator", WAVEFRONT, DECISION, *METHODS)

FORM = "failures apart"
"""Of results: those of another form are not gone on with."""

DRAW = "draw"
MOST_RUNS = 100_000_000


@dataclass(frozen=True, slots=True)
class Experiment:
    """Definition of a sweep.

    Attributes
    ----------
    template : str
        Name in the library, or file.
    axes : mapping of str to tuple
        Values by the axis: "boundary", "size", "precision", "method", "tau", "z", single weights as
        in "A[0, 1]". "A" and "B" are factors of all their weights, of those that an axis sets, too.
        "noise" is the standard deviation of the inputs. "mismatch" is that of all weights, as a
        share, alike in all cells. "offset" is that of a bias of each cell. "drift" is that of a
        bias that grows along a line: of its slope times the array's half diagonal. "bits" are of
        weights, matrix by matrix. Those of a `Chip`: "weight_bits", "state_bits" (of maps, which
        saturate at 1) and "chip_noise" (of the output). "chip_mismatch" is that of all weights,
        alike in all cells for A, and each cell's own for B and z. "chip_seed" is drawn anew for
        each run unless given.
    draws : int
        Number of random draws per combination of axis values.
    pictures : int
        Largest number of pictures from the template's check.
    seed : int
    duration : float, "settle" or None
        In the unit of τ, or until nothing changes any more. The default is that of the check.
    engine : str
    chunk : int
        Runs per task; with 0, it follows from the time of the first task. All multiples of 512
        give bit-identical results.

    Raises
    ------
    TemplateError, UnknownNameError
        If there is no such axis, value, engine or weight, or the template has no check.
    """

    template: str
    axes: Mapping[str, tuple[Value, ...]] = field(default_factory=dict[str, tuple[Value, ...]])
    draws: int = 1
    pictures: int = 4
    seed: int = 0
    duration: Duration | None = None
    engine: str = "opencl"
    chunk: int = 0

    def __post_init__(self) -> None:
        axes = dict[str, tuple[Value, ...]]()
        for given, values in self.axes.items():
            name = _axis_name(given)
            if name in axes:
                raise TemplateError(f"The axis '{name}' is given twice.")
            axes[name] = tuple(_plain_value(name, value) for value in values)
            if not axes[name]:
                raise TemplateError(f"The axis '{name}' needs at least one value, got none.")
        object.__setattr__(self, "axes", axes)
        for part in ("draws", "pictures", "seed", "chunk"):
            object.__setattr__(self, part, _whole(part, getattr(self, part)))
        if self.engine not in backend_names():
            raise name_error("engine", self.engine, backend_names())
        if min(self.draws, self.pictures) < 1 or self.runs > MOST_RUNS:
            raise TemplateError(
                f"An experiment must have 1 to {MOST_RUNS:,} runs, with at least one draw and "
                f"one picture, got {self.runs:,} runs."
            )
        if is_real(self.duration):
            object.__setattr__(self, "duration", float(self.duration))
            right = self.duration > 0.0
        else:
            right = self.duration is None or self.duration == "settle"
        if not right:
            raise TemplateError(
                "The duration of an experiment must be a number above 0 or 'settle', got "
                f"{self.duration!r:.40}."
            )
        form_of(self.base)  # refuses a template without a check
        if not self.base.plain and (own := self.axes.keys() & set(COARSE)):
            raise TemplateError(
                f"The axis '{min(own)}' belongs to chips, which need linear couplings without "
                f"delay that are constant in time; '{self.base.name}' has others."
            )
        for name in axes:
            _refuse_missing_weight(self.base, name)

    @property
    def base(self) -> Template:
        """The template before any change.

        Raises
        ------
        UnknownNameError, TemplateFileError, TemplateError
            If there is no such name.
        """
        from cnnum.templating.files import load_template

        place = Path(self.template)
        return load_template(place) if place.suffix else get_template(self.template)

    @property
    def order(self) -> tuple[str, ...]:
        """Axes, those of launches first, and the draws last."""
        outer = [name for name in OUTER if name in self.axes]
        return (*outer, *(name for name in self.axes if name not in OUTER), DRAW)

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes in their order."""
        return (*(len(self.axes[name]) for name in self.order[:-1]), self.draws)

    @property
    def runs(self) -> int:
        """Number of runs."""
        return math.prod(self.shape)

    @property
    def launched(self) -> int:
        """Runs that may share a launch."""
        outer = sum(name in OUTER for name in self.axes)
        return math.prod(self.shape[outer:])

    @property
    def key(self) -> str:
        """Digest of everything that affects the results, and of their format."""
        kept = [
            getattr(self, part.name) for part in fields(self) if part.name not in ("chunk", "axes")
        ]
        axes = tuple((name, self.axes[name]) for name in self.order[:-1])
        return digest(FORM, *map(str, kept), str(axes), self.base.digest)

    def place(self, run: int) -> dict[str, Value]:
        """Return the values on the axes of a run."""
        at = np.unravel_index(run, self.shape)
        return {
            name: self.axes[name][int(k)] for name, k in zip(self.order[:-1], at[:-1], strict=True)
        }

    def tasks(self, chunk: int) -> Iterator[tuple[int, int]]:
        """Yield the first run and the end of every task; no task spans several launches."""
        for start in range(0, self.runs, self.launched):
            for first in range(start, start + self.launched, chunk):
                yield first, min(first + chunk, start + self.launched)


def load_experiment(path: str | PathLike[str]) -> Experiment:
    """Load an experiment from a TOML file.

    Raises
    ------
    TemplateFileError, TemplateError
        If the file cannot be read, or a key is missing, unknown or wrong.
    """
    source = Path(path)
    return _experiment(str(source), toml.read_table("experiment", source))


def _experiment(file: str, content: dict[str, object]) -> Experiment:
    readers = {"template": toml.text, "draws": toml.whole, "pictures": toml.whole}
    readers |= {"seed": toml.whole, "duration": toml.number_or_text, "engine": toml.text}
    readers |= {"chunk": toml.whole}
    toml.refuse_unknown(file, content, (*readers, "axes"))
    if "template" not in content:
        raise TemplateError(f"'{file}': the key 'template' is missing; a sweep needs one.")
    values: dict[str, Any] = {
        key: read(file, key, content[key]) for key, read in readers.items() if key in content
    }
    axes = toml.table(file, "axes", content.get("axes", {}))
    values["axes"] = {name: _values(file, f"axes.{name}", value) for name, value in axes.items()}
    return Experiment(**values)


def _values(file: str, key: str, value: object) -> tuple[Value, ...]:
    """Return the values of an axis: a list, or from, to and count."""
    if isinstance(value, list):
        return tuple(_value(file, key, item) for item in cast("list[object]", value))
    if not isinstance(value, dict):
        raise toml.wrong(file, key, "a list, or a table with from, to and count", value)
    given = toml.table(file, key, cast(object, value))
    if set(given) != {"from", "to", "count"}:
        raise toml.wrong(file, key, "a list, or a table with from, to and count", given)
    start, stop = (toml.number(file, key, given[end]) for end in ("from", "to"))
    values: list[float] = np.linspace(start, stop, toml.whole(file, key, given["count"])).tolist()
    return tuple(values)


def _value(file: str, key: str, value: object) -> Value:
    return value if isinstance(value, str) else toml.number(file, key, value)


def _axis_name(given: object) -> str:
    """Return the name of an axis, that of a weight in one way."""
    name = str(given)
    if WEIGHT.fullmatch(name):
        row, col = (int(number) for number in name[2:-1].split(","))
        return f"{name[0]}[{row}, {col}]"
    if name not in (*OUTER, *INNER):
        raise TemplateError(
            f"Unknown axis '{name:.40}': expected one of {', '.join((*OUTER, *INNER))}, or "
            "a weight such as 'A[0, 1]'."
        )
    return name


def _plain_value(name: str, value: object) -> Value:
    """Return a value of an axis as a text or a float, so that equal experiments are equal.

    Raises
    ------
    TemplateError, UnknownNameError
        If the axis has no such value.
    """
    if isinstance(value, str):
        if name == "method" and value not in RUN_METHODS:
            raise name_error("method", value, RUN_METHODS)
        if name == "precision" and value not in PRECISIONS:
            if not is_integer(value):
                raise name_error("precision", value, PRECISIONS)
            precision_named(value)  # refuses what is no name
        if name == "boundary":
            parse_boundary(value)
        if name not in WORDS:
            raise TemplateError(f"The axis '{name}' takes numbers, got '{value:.40}'.")
        return str(value)
    if isinstance(value, bool | np.bool_) or not is_real(value) or name in ("method", "precision"):
        kind = "names" if name in ("method", "precision") else "finite numbers"
        raise TemplateError(f"The axis '{name}' takes {kind}, got {value!r:.40}.")
    number = float(value)
    least = (dict.fromkeys(WIDTHS, 0.0) | dict.fromkeys(BITS, 2.0)
             | {"tau": 1e-9, "size": 1.0, "chip_seed": 0.0}).get(name)  # fmt: skip
    if least is not None and number < least:
        raise TemplateError(f"The axis '{name}' takes numbers from {least:g}, got {value}.")
    if name in BITS and not (number.is_integer() and number <= MOST_BITS):
        raise TemplateError(
            f"The axis '{name}' takes whole numbers from 2 to {MOST_BITS}, got {value}."
        )
    if name in ("chip_seed", "size") and not number.is_integer():
        raise TemplateError(f"The axis '{name}' takes whole numbers, got {value}.")
    return number


def _whole(part: str, value: Any) -> int:
    try:
        number = operator.index(value)
    except TypeError:
        number = -1
    if isinstance(value, bool) or number < 0:
        raise TemplateError(f"'{part}' must be a whole number of at least 0, got {value!r:.40}.")
    return number


def _refuse_missing_weight(template: Template, name: str) -> None:
    """Check that the template has the weights of an axis."""
    if name[0] not in "AB" or name[1:2] not in ("", "["):
        return
    kernels = template.A if name[0] == "A" else template.B
    if not kernels.size:
        raise TemplateError(f"The axis '{name}' changes inputs, but '{template.name}' has none.")
    size = kernels.shape[-1]
    if name[1:] and max(int(number) for number in name[2:-1].split(",")) >= size:
        raise TemplateError(
            f"The axis '{name}' names a weight beyond the {size}×{size} cells of '{template.name}'."
        )


def grid(experiment: Experiment) -> Iterator[tuple[Value, ...]]:
    """Yield the axis values of every combination, without the draws."""
    yield from itertools.product(*(experiment.axes[name] for name in experiment.order[:-1]))
