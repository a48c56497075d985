"""What a scene, its program and its array must agree on: parameters, and what is wanted."""

import inspect
from collections.abc import Collection
from difflib import get_close_matches

from cnnum.drivers.driver import Driver
from cnnum.errors import SceneError, UnknownNameError, name_error
from cnnum.programs import Program
from cnnum.programs.quantities import PITCH, takes_pitch
from cnnum.safety.names import LONGEST, shown
from cnnum.scenes.events import EVENT_RULES
from cnnum.scenes.scene_file import EVERYTHING, SceneSpec


def bound(program: Program, spec: SceneSpec, driver: Driver) -> Program:
    """Return the program with the scene's parameters, and what its array knows of itself.

    The array's rate goes to a program that takes one. Its pitch goes to one that counts in pitches
    and is given a length.

    Raises
    ------
    SceneError
        If the program has no such parameter.
    ProgramError
        If one is of another type, or out of range.
    """
    known = inspect.signature(program.function).parameters
    extra = [PITCH] if PITCH not in known and takes_pitch(known) else []
    choices = [*(key for key in known if key != "frame"), *extra]
    for name in spec.parameters:
        if name not in choices:
            raise SceneError(f"Scene '{spec.name}': {name_error('parameter', name, choices)}")
    given = dict(spec.parameters)
    if "rate" in known and "rate" not in given and driver.rate > 0:
        given["rate"] = driver.rate
    pitch = getattr(driver, "pitch", None)
    if extra and PITCH not in given and isinstance(pitch, float):
        given[PITCH] = pitch
    return program.bind(**given)


def unknown_want(spec: SceneSpec, want: str, outputs: Collection[str]) -> UnknownNameError:
    """Return the error for a want that is no event and no output of the program."""
    near = get_close_matches(want[:LONGEST], list(dict.fromkeys([*EVENT_RULES, *outputs])), n=3)
    events = ", ".join(f"'{event}'" for event in EVENT_RULES)
    guess = ", ".join(f"'{name}'" for name in near)
    hint = f" (did you mean {guess}?)" if near else ""
    return UnknownNameError(
        f"Scene '{spec.name}' wants {shown(want)}, which the program '{spec.program}' does not "
        f"give{hint}: its events are {events} or '{EVERYTHING}', its fields {', '.join(outputs)}."
    )
