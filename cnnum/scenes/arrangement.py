"""Agreement of a scene, its program and its array: parameters and wanted outputs."""

import inspect
import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import cast

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.drivers.driver import Driver
from cnnum.drivers.geometry import Grid
from cnnum.drivers.registry import module_of
from cnnum.errors import (
    ArrayError,
    CnnumError,
    ProgramError,
    SceneError,
    UnknownNameError,
    name_error,
)
from cnnum.frame import FORCE_AXES, contradicted, differ, limits_of, time_unit_of
from cnnum.graph.nodes import Graph
from cnnum.programs import Program
from cnnum.programs.library import get_program, load_program, program_names
from cnnum.programs.machine import SATURATED
from cnnum.programs.parameters import PITCH, RATE, in_own_units, takes_pitch
from cnnum.safety.values import LONGEST, shown
from cnnum.scenes.events import EVENT_RULES, EventRule, rules_that_fit
from cnnum.scenes.scene_file import EVERYTHING, SceneSpec
from cnnum.tactile.bump_loads import DEEPEST, SHARP_UP_TO
from cnnum.tactile.cover import BumpCover, FlatCover, LayerCover

THINNEST, LOADS = 0.5, {EVERYTHING, "contact", "load_normal", "load_x", "load_y", "friction_used"}
"""Pitches of cover below which taxels see too little of the pressure between them, and the events
and outputs that suffer: under a third of a pitch, pressures that differ by their sampling alone
hold 0.63 to 1.31 times the load (`tests/tactile/test_contact_loads.py`)."""

LEAST_RATE = 1e-3
"""Hz, the least rate of a program."""

COUNT = "count"
"""Unit of values without a scale."""

PHYSICAL = ("thickness", "youngs_modulus")
"""Parameters of programs that take strain or stress, and nothing else."""

BUMP = "bump"
"""The name of every output of a bump begins so."""

ALL = "tactile"
"""The program with the outputs of the others: bumps are a part of it that few scenes want."""

NO_COVER = ("slip", "twist", "gross_slip", "flow", BUMP)
"""Begins of the outputs that ask for no depth of the cover, of programs that take one."""

TELLS = 0.01
"""Part by which a scene's fact of the cover may differ from the array's until it is said: digits
of a rounded one."""

PADS, NARROWEST = "pads", 3
"""Minimum columns of a pad, the width of a taxel's neighbourhood."""


def program_of(spec: SceneSpec) -> Program:
    """Return the program of a scene: one of the library, or the user's own."""
    return spec.program if isinstance(spec.program, Program) else named(spec.program, spec.base)


def named(program: str, base: Path = Path()) -> Program:
    """Return a program by its name in the library, or by its place, whose code is run.

    Parameters
    ----------
    program : str
        "slip", "module:function" or "file.py:function".
    base : Path
        Folder in which files, and modules that are not installed, are looked for.

    Raises
    ------
    UnknownNameError
        If the library or the file has none of that name.
    SceneError
        If the module or a program in it is not there.
    ProgramError
        If the file cannot be run.
    """
    place, colon, name = program.rpartition(":")
    if not colon:
        return get_program(program)
    if place.endswith(".py"):
        return load_program(base / place, name)
    result = getattr(module_of("program", place, base), name, None)
    if not isinstance(result, Program):
        raise SceneError(
            f"The program {shown(program)}: expected a function '{name}' under @cnnum.program in "
            f"the module '{place}'."
        )
    return result


def refuse_other_limits(spec: SceneSpec, driver: Driver) -> None:
    """Raise if a scene has limits for other channels than its array."""
    try:
        if spec.limits is not None:
            limits_of(spec.limits, len(driver.channels))
    except ArrayError as error:
        raise SceneError(f"Scene '{spec.name}': 'frames.limits': {error}") from None


def grid_of(spec: SceneSpec, driver: Driver) -> Grid | None:
    """Return the grid of taxels at known places: those of the scene, else those of the array.

    Raises
    ------
    SceneError
        If no grid can be made of them.
    """
    positions = spec.positions or getattr(driver, "positions", ())
    if not positions:
        return None
    pitch = spec.pitch or getattr(driver, "pitch", None)
    try:
        return Grid(positions, driver.shape, pitch, spec.dead)
    except SceneError as error:
        raise SceneError(f"Scene '{spec.name}': {error}") from None


def bound(
    program: Program, spec: SceneSpec, driver: Driver, grid: Grid | None = None, unit: str = ""
) -> Program:
    """Return the program with the scene's parameters, and the facts of its array.

    The program runs at the array's rate. Its pitch goes to one that counts in pitches and is given
    a length. An array that knows its bumps gives their geometry. One that knows its flat cover
    corrects depth and unit of a packaged scene, which are those of the usual cover; `unit` says
    what the program sees.

    Raises
    ------
    SceneError
        If the program has no such parameter, or a rate that contradicts the array's.
    ProgramError
        If one is of another type, or out of range.
    """
    known = inspect.signature(program.function).parameters
    extra = [PITCH] if PITCH not in known and takes_pitch(known) else []
    choices = [RATE, *(key for key in known if key not in ("frame", RATE)), *extra]
    for name in spec.parameters:
        if name not in choices:
            raise SceneError(f"Scene '{spec.name}': {name_error('parameter', name, choices)}")
    given = dict(spec.parameters)
    if driver.rate > 0:
        _refuse_other_rate(spec, driver.rate, given.setdefault(RATE, driver.rate))
    pitch = getattr(driver, "pitch", None) if grid is None else grid.pitch
    if extra and PITCH not in given and isinstance(pitch, float):
        given[PITCH] = pitch
    pads = getattr(driver, "pads", None)
    if PADS in known and PADS not in given and isinstance(pads, int):
        given[PADS] = pads
    if grid is not None and "bump_pitch" in known and (program.name != ALL or _wants_bumps(spec)):
        raise SceneError(
            f"Scene '{spec.name}': the program '{program.name}' reads one bump per taxel on a "
            "square grid, but these taxels have their own positions: leave out the bumps, or use "
            "'contact', 'slip' or 'twist'."
        )
    if "bump_pitch" in known and (program.name != ALL or _wants_bumps(spec)):
        given = {**_of_bumps(driver, known, given), **given}
    if _wants_cover(program, spec):
        # a recording of the array does not know its cover, and has to give the same: what a scene
        # of one's own does not say, it is not given
        facts = _of_cover(driver, known, given, pitch, unit)
        changed = {n: v for n, v in facts.items() if n in spec.usual and _differ(given[n], v)}
        given = {**given, **changed}
    return program.bind(**given)


def _refuse_other_rate(spec: SceneSpec, rate: float, given: object) -> None:
    """Raise if a scene gives its program another rate than its array has."""
    said = in_own_units(spec.name, {RATE: given}, {RATE: None})[RATE]
    if isinstance(said, int | float) and said > 0.0 and differ(float(said), rate):
        raise SceneError(
            f"Scene '{spec.name}': 'program.parameters.rate' is {said:g} Hz, but the array "
            f"has {rate:g} frames per second: leave it out to use the array's rate."
        )


def _wants_bumps(spec: SceneSpec) -> bool:
    return any(want == EVERYTHING or want.startswith(BUMP) for want in spec.needs)


def events_of_everything(driver: Driver) -> tuple[str, ...]:
    """Return the events that "everything" stands for: bumps only where the array has them."""
    bumps = isinstance(getattr(driver, "bumps", None), BumpCover)
    return tuple(name for name in EVENT_RULES if bumps or name != BUMP)


def cure_of_times(driver: Driver, times: Floats) -> str:
    """Return a sentence on times of a recording that seem to be no seconds; "" for others."""
    timed = getattr(driver, "timed", False) and contradicted(driver.rate, times) is None
    sure = getattr(driver, "live", False) or timed
    unit = "" if sure else time_unit_of(times)
    place = "[frames] of the scene" if getattr(driver, "layout", None) is None else "the layout"
    if not unit:
        return ""
    return f" They seem to be in {unit}: set time_unit = '{unit}' in {place}, or 's' if not."


def refuse_slow(spec: SceneSpec, driver: Driver) -> None:
    """Raise if the times of a recording make it slower than any program allows.

    Raises
    ------
    SceneError
        With the unit that its times seem to have.
    """
    if not 0.0 < driver.rate < LEAST_RATE:
        return
    step = 1.0 / driver.rate
    raise SceneError(
        f"Scene '{spec.name}': frames of the array are {step:.4g} s apart, expected at most "
        f"{1.0 / LEAST_RATE:g} s.{cure_of_times(driver, np.array([0.0, step]))}"
    )


def warn_of_no_bumps(spec: SceneSpec, driver: Driver) -> None:
    """Say on the logger "cnnum" that a scene asks for bumps of an array that has none."""
    wanted = [want for want in spec.needs if want.startswith(BUMP)]
    there = isinstance(getattr(driver, "bumps", None), BumpCover)
    if wanted and hasattr(driver, "bumps") and not there:
        logging.getLogger("cnnum").warning(
            "Scene '%s' wants '%s', but its array has no bumps, so the reported loads on bumps "
            "have no meaning; set 'array.cover' to \"bumpy\", or leave it out.",
            spec.name,
            wanted[0],
        )


def _of_bumps(
    driver: Driver, known: Collection[str], given: Mapping[str, object]
) -> dict[str, object]:
    """Return the parameters of a program that the array's bumps give."""
    bumps, pitch = getattr(driver, "bumps", None), getattr(driver, "pitch", None)
    if not isinstance(bumps, BumpCover) or not isinstance(pitch, float):
        return {}
    strain = given.get("taxels", "strain") == "strain"
    newtons = bumps.bump_radius**2 * (bumps.youngs_modulus if strain else 1.0)
    facts: dict[str, object] = {
        "taxels": "strain",
        "bump_pitch": pitch / bumps.bump_radius,
        "bump_depth": bumps.relative_depth,
        "bump_unit" if "bump_unit" in known else "unit": newtons,
    }
    return {name: value for name, value in facts.items() if name in known}


def _wants_cover(program: Program, spec: SceneSpec) -> bool:
    if not spec.needs:  # events of the scene's own alone
        return program.name != ALL
    return not all(want.startswith(NO_COVER) for want in spec.needs)


def _of_cover(
    driver: Driver, known: Collection[str], given: Mapping[str, object], pitch: object, unit: str
) -> dict[str, object]:
    """Return the parameters of a program that the array's flat cover gives."""
    cover = getattr(driver, "cover", None)
    if not isinstance(cover, FlatCover) or not isinstance(pitch, float):
        return {}
    facts: dict[str, object] = {}
    if cover.depth <= DEEPEST * pitch:
        facts["depth"] = cover.depth / pitch
    strain = unit == "strain" and given.get("reads", "strain") == "strain"
    if strain and "depth" in known and "reads" in known:
        facts["unit"] = 2.0 / 3.0 * cover.youngs_modulus * pitch**2
    return {name: value for name, value in facts.items() if name in known}


def _differ(said: object, there: object) -> bool:
    """Return whether a fact of the cover is another one, beyond the digits of a rounded one."""
    if not isinstance(said, float) or not isinstance(there, float):
        return False
    return abs(said / there - 1.0) > TELLS


def warn_of_other_cover(program: Program, spec: SceneSpec, driver: Driver, unit: str) -> None:
    """Say on the logger "cnnum" that a program takes the array's cover for another one.

    `unit` is that of the values that the program sees, as in `bound`. A cover that is too thick for
    a part of the program is said of any array.
    """
    _warn_of_lost_edges(program, spec)
    pitch = cast(float | None, getattr(driver, "pitch", None))
    cover, known = getattr(driver, "cover", None), inspect.signature(program.function).parameters
    asks = next((name for name in ("depth", "thickness") if name in known), None)
    if asks is None or not _wants_cover(program, spec):
        return
    if cover is None and asks in spec.usual:
        _warn_of_unknown_cover(program, spec)
    if cover is None or pitch is None:
        return
    facts = _of_cover(driver, known, dict(program.parameters), pitch, unit)
    if not isinstance(cover, FlatCover):
        kind = "a layer on a rigid base" if isinstance(cover, LayerCover) else "a cover with bumps"
        cure = "set 'array.cover' to \"flat\""
        if isinstance(cover, BumpCover):
            cure = "take 'localize', which knows bumps"
        why = f"it takes the cover for a thick flat one, and the array has {kind}: {cure}"
    elif cover.depth > DEEPEST * pitch and asks == "depth":
        why = (
            f"the cover of the array is {cover.depth / pitch:.3g} pitches thick, and nothing below "
            f"{DEEPEST:g} shows through: take a thinner one"
        )
    elif cover.depth < THINNEST * pitch and LOADS & {*spec.needs}:
        why = (
            f"the cover of the array is {cover.depth / pitch:.3g} pitches thick, and below "
            f"{THINNEST:g} loads a third less or more give the same readings: take a thicker one"
        )
    elif contradiction := _contradicted(program, spec, cover, pitch, facts.get("unit")):
        why = contradiction
    else:
        return
    logging.getLogger("cnnum").warning(
        "Scene '%s': contact can be detected, but loads, positions and shapes from the program "
        "'%s' are not known: %s.",
        spec.name, spec.program_name, why,
    )  # fmt: skip


def _warn_of_unknown_cover(program: Program, spec: SceneSpec) -> None:
    """Say that a packaged scene takes any array's cover for that of the simulated one."""
    given = dict(program.parameters)
    said = " and ".join(
        f"'program.parameters.{name}' ({given[name]:.4g})"
        for name in ("depth", "unit")
        if name in spec.usual and name in given
    )
    logging.getLogger("cnnum").warning(
        "Scene '%s': the array does not state its cover, and loads, places and shapes by the "
        "program '%s' are right under the scene's own only: set %s to those of yours.",
        spec.name, spec.program_name, said,
    )  # fmt: skip


def _warn_of_lost_edges(program: Program, spec: SceneSpec) -> None:
    depth = dict(program.parameters).get("depth")
    wanted = any(want.startswith("edge") or want == EVERYTHING for want in spec.needs)
    if wanted and isinstance(depth, float) and depth > SHARP_UP_TO:
        logging.getLogger("cnnum").warning(
            "Scene '%s': under %.3g pitches of cover the program '%s' misses edges, because "
            "sharp details do not show through more than %g: use 'edge_enhancement', which finds "
            "outlines through any cover.",
            spec.name, depth, spec.program_name, SHARP_UP_TO,
        )  # fmt: skip


def _contradicted(
    program: Program, spec: SceneSpec, cover: FlatCover, pitch: float, newtons: object
) -> str:
    """Return what a scene, or a program unless told otherwise, takes the array's cover for.

    `newtons` is the load of a taxel that reads 1, None if it is not known.
    """
    there = {"depth": cover.depth / pitch, "thickness": cover.depth,
             "youngs_modulus": cover.youngs_modulus}  # fmt: skip
    known = inspect.signature(program.function).parameters
    bound_to = {
        **{name: parameter.default for name, parameter in known.items()},
        **dict(program.parameters),
    }
    if bound_to.get("reads") == "force":  # each taxel carries its own share, whatever the cover
        return ""
    for name, own in there.items():
        said = bound_to.get(name)
        if _differ(said, own):
            unset = "" if name in spec.parameters else " unless it is set"
            more = ""
            if "unit" not in spec.parameters and isinstance(newtons, float):
                more = f", and 'program.parameters.unit' to {newtons:.4g} for newtons"
            return (
                f"'program.parameters.{name}' is {said:.4g}{unset}, and {own:.4g} by the array: "
                f"set it to that{more}"
            )
    return ""


def refuse_unfit(program: Program, spec: SceneSpec, driver: Driver, unit: str) -> None:
    """Raise if a program's parameters do not fit the array's values.

    Parameters
    ----------
    program : Program
        With its parameters.
    spec : SceneSpec
    driver : Driver
    unit : str
        Unit of the values that the program sees.

    Raises
    ------
    SceneError
        If counts meet lengths, loads or moduli, or the pads are not those of the array.
    """
    known = inspect.signature(program.function).parameters
    physical = [name for name in PHYSICAL if name in known]
    physical_names = [
        name for name in ("unit", PITCH) if name in spec.parameters and name not in physical
    ]
    physical_names += [n for n in ("depth",) if isinstance(spec.parameters.get(n), str)]
    if unit == COUNT and (physical or physical_names):
        raise SceneError(
            f"Scene '{spec.name}': the array gives counts, and "
            f"'{[*physical_names, *physical][0]}' of the program '{spec.program_name}' is in "
            "physical units, which counts have no scale for: "
            "calibrate the array with 'calibration.gain' and 'calibration.unit', or leave it out."
        )
    _refuse_pads(program, spec, driver)


def _refuse_pads(program: Program, spec: SceneSpec, driver: Driver) -> None:
    """Raise if a program takes the columns of an array for other pads than they are."""
    pads = dict(program.parameters).get(PADS)
    if not isinstance(pads, int) or pads < 2:
        return
    rows, cols = driver.shape
    there = getattr(driver, PADS, None)
    if there == pads or (there is None and cols // pads >= NARROWEST):
        return
    seen = f"{there} pad(s)" if isinstance(there, int) else f"pads of {cols // pads} column(s)"
    raise SceneError(
        f"Scene '{spec.name}': 'pads' = {pads} on an array of {rows}×{cols} taxels, which is "
        f"{seen}: set 'program.parameters.pads' to the pads that lie side by side."
    )


def traced(program: Program, spec: SceneSpec, shape: Shape, channels: Sequence[str]) -> Graph:
    """Return the operations of a program on an array.

    Raises
    ------
    SceneError
        If the program reads an axis that the array does not.
    """
    try:
        return program.trace(shape, channels)
    except (UnknownNameError, ProgramError):
        missing = missing_axes(channels)
        if not missing or not _runs(program, shape, (*channels, *missing)):
            raise
    raise SceneError(
        f"Scene '{spec.name}': the program '{spec.program_name}' needs {_listed(missing)}, which "
        f"the array does not read (it reads {', '.join(c for c in channels if c != SATURATED)}): "
        "take another program; 'cnnum plan' lists what such an array can give."
    ) from None


def missing_axes(channels: Collection[str]) -> tuple[str, ...]:
    """Return the force axes that an array does not read; none of one that reads no axis at all."""
    if not any(axis in channels for axis in FORCE_AXES):
        return ()
    return tuple(axis for axis in FORCE_AXES if axis not in channels)


def refuse_missing_axes(
    program: Program,
    spec: SceneSpec,
    shape: Shape,
    channels: Sequence[str],
    outputs: Collection[str],
) -> None:
    """Raise SceneError if a scene wants what its program gives of three axes and not of these."""
    missing = missing_axes(channels)
    lost = [
        want
        for want in spec.needs
        if missing and want not in outputs and not rules_that_fit([want], outputs)
        and want not in spec.own and want != EVERYTHING
    ]  # fmt: skip
    if not lost:
        return
    whole = _outputs(program, shape, (*channels, *missing))
    for want in lost:
        if want in whole or rules_that_fit([want], whole):
            raise SceneError(
                f"Scene '{spec.name}': '{want}' of the program '{spec.program_name}' needs "
                f"{_listed(missing)}, which the array does not read (it reads "
                f"{', '.join(channels)}): leave it out; 'cnnum plan' lists what such an array can "
                "give."
            )


@dataclass(frozen=True, slots=True)
class Given:
    """An event that some program of the library gives from three axes.

    Attributes
    ----------
    event : str
    programs : tuple of str
        Those that give it on this array.
    missing : tuple of str
        Axes that the array lacks for it; empty if a program gives it.
    """

    event: str
    programs: tuple[str, ...]
    missing: tuple[str, ...]


def given_by(shape: Shape, channels: Sequence[str]) -> tuple[Given, ...]:
    """Return what the library can report of an array with these channels, event by event."""
    missing = missing_axes(channels)
    if not any(axis in channels for axis in FORCE_AXES):
        return ()
    able: dict[str, list[str]] = {event: [] for event in EVENT_RULES}
    named = dict.fromkeys(able, False)
    rooms = (*program_names("tactile"), *program_names("tactile.contact_mechanics"))
    for name in (room for room in rooms if room != ALL):
        program = get_program(name)
        whole = _outputs(program, shape, (*channels, *missing))
        here = _outputs(program, shape, channels) if missing else whole
        for event in able:
            named[event] = named[event] or bool(rules_that_fit([event], whole))
            if rules_that_fit([event], here):
                able[event].append(name)
    return tuple(
        Given(event, tuple(names), () if names else missing)
        for event, names in able.items()
        if named[event]
    )


def _outputs(program: Program, shape: Shape, channels: Sequence[str]) -> tuple[str, ...]:
    return tuple(program.trace(shape, channels).outputs) if _runs(program, shape, channels) else ()


def _runs(program: Program, shape: Shape, channels: Sequence[str]) -> bool:
    try:
        program.trace(shape, channels)
    except CnnumError:
        return False
    return True


def _listed(names: Sequence[str]) -> str:
    return " and ".join(f"'{name}'" for name in names)


def wants_of(spec: SceneSpec, outputs: Collection[str], known: Collection[str]) -> tuple[str, ...]:
    """Return the outputs that a scene wants, by name where it wants everything."""
    if EVERYTHING not in spec.needs:
        for want in spec.needs:
            if want not in EVENT_RULES and want not in outputs and want not in spec.own:
                raise _unknown_want(spec, want, outputs)
        return tuple(dict.fromkeys((*spec.needs, *spec.own)))
    events = (want for want in known if rules_that_fit([want], outputs))
    return tuple(dict.fromkeys((*spec.own, *events, *outputs)))


def rules_of(
    spec: SceneSpec, wants: Sequence[str], outputs: Collection[str]
) -> tuple[EventRule, ...]:
    """Return the rules of the wanted events; one whose outputs the program lacks is no part of it.

    Raises
    ------
    SceneError
        If the program gives nothing of a wanted event.
    """
    result: list[EventRule] = []
    for want in wants:
        if own := [rule for rule in spec.events if rule.kind == want]:
            result += [_fitting(spec, rule, outputs) for rule in own]
            continue
        fitting = rules_that_fit([want], outputs)
        if want in EVENT_RULES and not fitting:
            raise SceneError(
                f"Scene '{spec.name}' wants '{want}', which the program '{spec.program_name}' does "
                f"not give: it has {', '.join(outputs)}."
            )
        result += fitting
    return tuple(result)


def _fitting(spec: SceneSpec, rule: EventRule, outputs: Collection[str]) -> EventRule:
    """Return a rule of the user's own, all of whose outputs the program gives."""
    for name in rule.needs:
        if name not in outputs:
            raise SceneError(
                f"Scene '{spec.name}': the event '{rule.kind}' reads '{name}', which the program "
                f"'{spec.program_name}' does not give: {name_error('output', name, outputs)}"
            )
    return rule


def _unknown_want(spec: SceneSpec, want: str, outputs: Collection[str]) -> UnknownNameError:
    """Return the error for a want that is no event and no output of the program."""
    known = [*spec.own, *EVENT_RULES]
    near = get_close_matches(want[:LONGEST], list(dict.fromkeys([*known, *outputs])), n=3)
    events = ", ".join(f"'{event}'" for event in known)
    guess = ", ".join(f"'{name}'" for name in near)
    hint = f" (did you mean {guess}?)" if near else ""
    return UnknownNameError(
        f"Scene '{spec.name}' wants {shown(want)}, which the program '{spec.program_name}' does "
        f"not give{hint}: its events are {events} or '{EVERYTHING}', its fields "
        f"{', '.join(outputs)}."
    )
