"""Analogic programs: Python functions of a frame's maps, traced once into a graph.

    @cnnum.program
    def touched(frame):
        return {"contact": (frame.normal > 0.1).any()}

Inside, `frame` and all that is computed from it are `Field`s: they record the operations
and hold no numbers, so a Python `if` on one of them is refused.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from operator import attrgetter
from typing import cast

from cnnum.arrays import as_shape
from cnnum.errors import OtherProcessError, ProgramError, SizeError
from cnnum.frame import FORCE_AXES
from cnnum.graph.nodes import Graph
from cnnum.programs.fields import Field, as_field
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import RATE, checked_parameters
from cnnum.safety.values import checked_name

Traced = Callable[..., Mapping[str, Field]]


@dataclass(frozen=True, slots=True)
class Program:
    """Analogic program: a function of the maps of a frame that returns named outputs.

    Attributes
    ----------
    function : callable
        Takes the frame's fields and keyword parameters, and returns a mapping of names to fields.
    name : str
    parameters : tuple of (str, value)
        Keyword parameters set with `bind`.

    Raises
    ------
    ProgramError
        If the name is not one line of printable characters.
    """

    function: Traced
    name: str
    parameters: tuple[tuple[str, object], ...] = ()

    def __post_init__(self) -> None:
        checked_name("a program", self.name, ProgramError)

    def bind(self, **parameters: object) -> "Program":
        """Return the program with keyword parameters of its function set.

        Every program accepts ``rate``, the frame rate of its stream (`FrameFields.rate`), which a
        scene takes from its array. A length, rate, load or modulus may be a text with a unit, such
        as ``rate="100 Hz"``. A depth is in pitches of the array; to give it as a length, set the
        pitch as well: ``depth="1 mm", pitch="1.5 mm"``.

        Raises
        ------
        ProgramError
            If the function has no such parameter, or its annotation names another type.
        """
        if parameters:
            parameters = checked_parameters(self.name, self.function, parameters)
        merged = {**dict(self.parameters), **parameters}
        return Program(self.function, self.name, tuple(merged.items()))

    def __call__(self, frame: FrameFields) -> Mapping[str, Field]:
        """Use the program inside another one.

        Raises
        ------
        ProgramError
            If it is called on numbers, or bound to another rate than the program around it.
        """
        if not isinstance(cast(object, frame), FrameFields):
            raise ProgramError(
                f"Program '{self.name}' was called on {type(frame).__name__}, but a program "
                f"does not run by itself: build plan = engine.compile({self.name}, "
                "shape=(rows, cols)) and call plan(frame)."
            )
        given = dict(self.parameters)
        rate = given.get(RATE)
        own = RATE in inspect.signature(self.function).parameters
        if isinstance(rate, int | float):
            frame.run_at(float(rate), self.name, uses=own)
        if not own:
            given.pop(RATE, None)
        return self.function(frame, **given)

    @property
    def rate(self) -> float | None:
        """Frame rate that the program is bound to, Hz, or None."""
        rate = dict(self.parameters).get(RATE)
        return float(rate) if isinstance(rate, int | float) else None

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the place of the function: a worker imports it.

        Raises
        ------
        OtherProcessError
            If the function is not defined at the top of a module.
        """
        place = self.function.__module__, self.function.__qualname__
        try:
            resolved = _program_at(*place)
        except (ImportError, AttributeError):
            resolved = None
        if not (isinstance(resolved, Program) and resolved.function is self.function):
            raise OtherProcessError(
                f"Program '{self.name}' cannot be pickled, because '{place[1]}' of the module "
                f"'{place[0]}' is another object: define it at the top of a module."
            )
        return _again, (*place, self.name, self.parameters)

    def trace(self, shape: Sequence[int], channels: Sequence[str] = FORCE_AXES) -> Graph:
        """Return the program's graph for an array of shape (rows, cols).

        Raises
        ------
        ProgramError
            If a channel's name is not one line of printable characters, or if the function does not
            return a mapping of such names to maps and numbers.
        SizeError
            If the memory of the machine is too small for a map.
        """
        graph = Graph(as_shape(shape))
        frame = FrameFields(graph, channels, self.rate)
        try:
            returned = self(frame)
        except MemoryError as error:  # of a map of constants
            raise SizeError(
                f"Program '{self.name}' needs more memory than is available for {graph.shape} "
                f"cells ({error}): use fewer cells."
            ) from None
        items = returned.items() if hasattr(returned, "items") else ()
        if not items:
            raise ProgramError(
                f"Program '{self.name}' must return a dict of named fields, got "
                f"{type(returned).__name__}."
            )
        for name, _ in items:
            checked_name(f"an output of program '{self.name}'", name, ProgramError)
        fields = {name: as_field(graph, value) for name, value in items}
        for name, field in fields.items():
            if field.maps > 1:
                raise ProgramError(
                    f"Output '{name}' of program '{self.name}' is a stack of {field.maps} "
                    "maps, but outputs must be maps or numbers."
                )
        graph.outputs.update({name: field.node for name, field in fields.items()})
        return graph


def _program_at(module: str, qualname: str) -> object:
    return attrgetter(qualname)(import_module(module))


def _again(
    module: str, qualname: str, name: str, parameters: tuple[tuple[str, object], ...]
) -> Program:
    """Return a program that was pickled."""
    result = cast(Program, _program_at(module, qualname))
    return Program(result.function, name, parameters)


def program(function: Traced) -> Program:
    """Turn a function into an analogic program, which is traced when an engine compiles it.

    Raises
    ------
    ProgramError
        If the argument is not a function, or is a lambda, which has no name.
    """
    if not callable(function):
        raise ProgramError(f"cnnum.program expects a function, got {type(function).__name__}.")
    name = getattr(function, "__name__", "program")
    if name == "<lambda>":
        raise ProgramError(
            "A lambda has no name, which a program needs: use 'def' with @cnnum.program above it."
        )
    return Program(function, name)
