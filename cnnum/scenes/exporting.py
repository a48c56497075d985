"""Programs as C99 for a microcontroller: whose frames, at which rate, with which ranges."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from os import PathLike
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats, Shape, as_shape
from cnnum.drivers.recording_file import load_recording
from cnnum.drivers.simulated import hands
from cnnum.drivers.simulated.grips import SHAKEN, Array, Arrays, Trial, power, pulled, twisted
from cnnum.embedded.c.files import Exported, Facts
from cnnum.embedded.formats import precision_named
from cnnum.embedded.lowering.builder import solvers_for
from cnnum.embedded.making import Made, make, make_with
from cnnum.embedded.measuring import Seen, measured
from cnnum.errors import ArrayError, ProgramError, SceneError, name_error
from cnnum.frame import FORCE_AXES
from cnnum.graph.schedule import Schedule, schedule
from cnnum.programs import Program
from cnnum.programs.fields import Field
from cnnum.programs.library import program_names
from cnnum.programs.machine import FrameFields
from cnnum.recordings.recording import Recording
from cnnum.safety.values import expect, shown
from cnnum.scenes.arrangement import bound, named, program_of
from cnnum.scenes.conversion import unit_of
from cnnum.scenes.pipeline import Scene
from cnnum.scenes.scene_code import with_scene

RATE = 200.0
"""Hz of the streams, and the parameter of programs."""

RADIUS = {4: 15e-3}
"""m, of the sphere on small arrays, whose taxels lie as close as others'."""

FASTEST = 10_000.0
"""Hz; three seconds of more frames take minutes to simulate and to measure."""

APART = 20
"""Step between the frames of a program without memories."""

MEASURED = 3
"""Seeds of each kind of stream on which ranges are measured."""


@cache
def trials(shape: Shape, seed: int, count: int, rate: float = RATE) -> tuple[Trial, ...]:
    """Return scenes that slip, twist and rest: `count` of each, from a seed on."""
    arrays = Arrays()
    array = Array(shape, rate=rate, radius=RADIUS.get(min(shape)))
    makers = (
        ("slip", pulled(power(1.0), array)),
        ("slip, gains", pulled(power(2.0), array, SHAKEN)),
        ("twist", twisted(array)),
    )
    result = [maker(arrays, name, n) for name, maker in makers for n in range(seed, seed + count)]
    if shape == (8, 8):
        grip = hands.held(hands.grips)
        result += [grip(arrays, "grip", n) for n in range(seed, seed + count)]
    return tuple(result)


def side_by_side(some: Sequence[Trial], most: int | None = None) -> Floats:
    """Return streams side by side, (frames, streams, rows, cols, 3); the last frame repeats."""
    longest = max(len(part.frames) for part in some)
    longest = longest if most is None else min(longest, most)
    padded = [
        np.concatenate([t.frames[:longest], np.repeat(t.frames[-1:], longest - len(t.frames), 0)])
        if len(t.frames) < longest
        else t.frames[:longest]
        for t in some
    ]
    return np.stack(padded, axis=1).astype(np.float64)


@cache
def measuring_frames(shape: Shape, rate: float = RATE) -> Floats:
    """Return the streams on which ranges are measured: 3 s each."""
    return side_by_side(trials(shape, 0, MEASURED, rate), max(60, round(3.0 * rate)))


def together(programs: Sequence[Program], rate: float) -> Program:
    """Return one program of several: fields that they share are computed once.

    Parameters
    ----------
    programs : sequence of Program
    rate : float, Hz
        Of those that are bound to none.

    Returns
    -------
    Program
        Its name is theirs, joined by "_". An output that several have under one name has the name
        of its program before it, as in "slip_contact", unless it is the same field.

    Raises
    ------
    ProgramError
        If a program is named twice; at its trace, if two outputs would have one name.
    """
    timed = [part if part.rate is not None else part.bind(rate=rate) for part in programs]
    labels = [part.name for part in programs]
    if twice := sorted({label for label in labels if labels.count(label) > 1}):
        raise ProgramError(f"Program '{twice[0]}' is named twice: name each program once.")

    def all_of_them(frame: FrameFields) -> Mapping[str, Field]:
        given = [(part.name, dict(part(frame))) for part in timed]
        nodes = dict[str, set[int]]()
        for _, fields in given:
            for name, output in fields.items():
                nodes.setdefault(name, set()).add(output.node.index)
        result = dict[str, Field]()
        for program, fields in given:
            for name, output in fields.items():
                label = name if len(nodes[name]) == 1 else f"{program}_{name}"
                if result.setdefault(label, output).node.index != output.node.index:
                    raise ProgramError(
                        f"Two outputs would be named '{label}': rename one of them, or a program."
                    )
        return result

    joined = Program(all_of_them, "_".join(part.name for part in timed))
    return joined.bind(rate=rate)


def bound_program(name: str) -> Program:
    """Return a program, of the library or by its place, at the rate of the streams."""
    several = [named(part) for part in name.split(",")]
    return together(several, RATE) if len(several) > 1 else several[0].bind(rate=RATE)


def schedule_of(name: str, shape: Shape, needs: Sequence[str] | None = None) -> Schedule:
    """Return the schedule of a program of the library on three-axial frames.

    Raises
    ------
    UnknownNameError
        If there is no such program or output.
    """
    return schedule(bound_program(name).trace(shape, FORCE_AXES), FORCE_AXES, needs)


def made(
    name: str,
    shape: Shape,
    precision: str,
    method: str = "auto",
    needs: Sequence[str] | None = None,
) -> Made:
    """Return a program of the library in a precision, its ranges measured on simulated scenes.

    Raises
    ------
    NotSupportedError
        If something in it has no form in this precision.
    UnknownNameError
        If there is no such program, output or precision.
    """
    kind, result = precision_named(precision), schedule_of(name, shape, needs)
    wanted = None if needs is None else tuple(needs)
    seen = _seen(name, shape, method, wanted) if kind.integer else Seen()
    label, solvers = bound_program(name).name, solvers_for(result, method)
    made = make_with(label, result, solvers, kind, seen, method)
    return replace(made, shares="," in name)


@lru_cache(maxsize=4)
def _seen(name: str, shape: Shape, method: str, needs: tuple[str, ...] | None) -> Seen:
    """Return the ranges of a program's values: whole numbers of any length share them."""
    result = schedule_of(name, shape, needs)
    step = 1 if result.memories else APART
    return measured(result, solvers_for(result, method), measuring_frames(shape)[::step])


def pictures(shape: Shape) -> Floats:
    """Return random black-and-white pictures, of single cells and of objects.

    Returns
    -------
    (4, 32, rows, cols, 1) float
        Four frames of 32 streams; -1 is white and 1 black.
    """
    random = np.random.default_rng(0)
    noise = random.standard_normal((4, 32, *shape, 1))
    rough, smooth = noise[:2], noise[2:]
    moved = [np.roll(smooth, (row, col), (2, 3)) for row in (-1, 0, 1) for col in (-1, 0, 1)]
    return np.where(np.concatenate([rough, np.sum(moved, axis=0)]) > 0.0, 1.0, -1.0)


def vector_streams(shape: Shape, count: int, rate: float = RATE) -> Floats:
    """Return simulated streams among which a test vector is chosen, as `vector_parts` does."""
    scenes = trials(shape, 0, MEASURED, rate)[::MEASURED]
    return vector_parts([scene.frames for scene in scenes], count)


def vector_parts(scenes: Sequence[NDArray[Any]], count: int) -> Floats:
    """Return streams among which a test vector is chosen, (count, streams, rows, cols, channels).

    They are parts of the scenes, as fast as they were taken or with frames left out up to the
    whole scene, and numbers at random, each held for some frames.

    Parameters
    ----------
    scenes : sequence of (frames, rows, cols, channels) float
    count : int
        Frames of a stream.
    """
    result, like = list[Floats](), scenes[0]
    for scene in scenes:
        whole = len(scene) // count or 1
        for step in sorted({1, whole}):
            last = max(0, len(scene) - step * count)
            for start in sorted({0, last // 2, last}):
                part = scene[start::step][:count].astype(np.float64)
                rest = np.repeat(part[-1:], count - len(part), axis=0)
                result.append(np.concatenate([part, rest]))
    largest = np.max([np.abs(scene).max(axis=(0, 1, 2)) for scene in scenes], axis=0)
    random = np.random.default_rng(0)
    for held in (1, 1, 3, 8):
        numbers = random.uniform(-1.0, 1.0, (-(-count // held), *like.shape[1:])) * largest
        result.append(np.repeat(numbers, held, axis=0)[:count])
    return np.stack(result, axis=1).astype(np.float64)


def vector_frames(shape: Shape, count: int) -> Floats:
    """Return frames of one stream: of a slip, after the rest."""
    frames = trials(shape, 0, MEASURED)[0].frames
    start = max(0, min(len(frames) - count, len(frames) // 2))
    return frames[start : start + count].astype(np.float64)


SHORT, LONG = 48, 0.8
"""Frames of each stream of the test vector; where outputs stay the same in them, s, in which
programs have learned what rest is, and frames of contact follow."""

COMPARED = 2.0
"""s of two typical streams, of a slip and of a turn, on which outputs are compared with floats."""

PICTURES = 6
"""Pictures of each stream of a test vector."""

MOST = 3000
"""Frames of a recording that are looked at, from its start on."""

SIMULATED = "strain"

PICTURE, GREY = "picture", "-1 white to 1 black"
"""Channel of the library's programs for pictures, and its unit."""


def export(
    program: Program | str | Sequence[Program | str],
    shape: Sequence[int] | None = None,
    *,
    precision: str = "q15",
    method: str = "auto",
    needs: Sequence[str] | None = None,
    channels: Sequence[str] | None = None,
    rate: float | None = None,
    like: "Recording | ArrayLike | str | PathLike[str] | Scene | None" = None,
    share_memory: bool = False,
) -> Exported:
    """Return a program as self-contained C99, with a test vector and a Makefile.

    Parameters
    ----------
    program : Program or str, or a sequence of them
        A program with its parameters, the name of one of the library, or "file.py:function".
        Several are exported as one, which computes common fields once and shares memory.
    shape : (rows, cols), optional
        The default is that of `like`, or 8×8.
    precision : str
        "q15", "q7", another "qM.N", or "float32".
    method : "auto" or "euler"
        For coupled cells: exact products where possible, or Euler steps.
    needs : sequence of str, optional
        Outputs to export. The default is all.
    channels : sequence of str, optional
        Channels of a frame, in order. The default is those of `like`; without `like`, "picture" for
        a program that processes pictures, and x, y and normal for any other.
    rate : float, Hz, optional
        Frame rate, for a program with times. The default is that of `like`, or 200.
    like : Recording, array, path or Scene, optional
        Typical frames, on which the range of every value is measured: a recording, its file, an
        array (frames, rows, cols, channels), or a scene, which is run to its end and calibrated.
        The default is strain of simulated scenes, or random black-and-white pictures.
    share_memory : bool
        Whether working arrays that are not needed at the same time share memory; those of several
        programs always do. The answers are the same.

    Returns
    -------
    Exported
        `write(folder)` writes the files.

    Raises
    ------
    NotSupportedError
        If something in the program cannot be exported in this precision.
    ArrayError
        If the frames do not fit the program.
    ProgramError
        If `program` is not a program.
    UnknownNameError
        If there is no such program, output, precision or channel.
    """
    given = [program] if isinstance(program, str | Program) else _several(program)
    several = [named(part) if isinstance(part, str) else part for part in given]
    for part in several:
        expect("program", part, Program, ProgramError)
    known_pictures = program_names("pictures")
    if like is None and channels is None and all(p.name in known_pictures for p in several):
        channels = (PICTURE,)
    seen = Examples.of(like, shape, channels, rate)
    chosen = several[0] if len(several) == 1 else together(several, seen.rate)
    timed = chosen if chosen.rate is not None else chosen.bind(rate=seen.rate)
    traced = timed.trace(seen.shape, seen.channels)
    wanted = schedule(traced, seen.channels, None if needs is None else tuple(needs))
    # frames of a program without memories need not follow each other
    streams = seen.measured[:: 1 if wanted.memories or not seen.simulated else APART]
    made = make(timed.name, wanted, precision_named(precision), streams, method)
    made = replace(made, shares=share_memory or len(several) > 1)
    facts = Facts(traced.rate if traced.timed else None, seen.unit, precision, method)
    # waves may take a thousand steps per picture, and no picture depends on others
    pictures = seen.unit == GREY
    exported = made.export(seen.parts(PICTURES if pictures else SHORT), facts=facts)
    if exported.vector.still and not pictures:
        longer = made.export(seen.parts(seen.frames_in(LONG)), facts=facts)
        if len(longer.vector.still) < len(exported.vector.still):
            exported = longer
    compared = streams[: seen.frames_in(COMPARED), :: max(1, streams.shape[1] // 2)]
    return replace(exported, errors=made.errors(compared))


def _several(programs: object) -> list[Program | str]:
    """Return several programs; what is none of them is found out by the caller."""
    if isinstance(programs, Sequence) and programs:
        return list(cast("Sequence[Program | str]", programs))
    return [cast("Program", programs)]


def export_scene(scene: Scene, *, precision: str = "q15", method: str = "auto") -> Exported:
    """Return the program of a scene as C99: with its parameters, and the outputs that it wants.

    Ranges are measured on the scene's frames, calibrated as it says, to their end. The C has also
    the calibration, from raw frames to inputs, and the rules of events, from answers to events.
    """
    if scene.grid is not None:
        rows, cols = scene.grid.shape
        raise SceneError(
            f"Scene '{scene.spec.name}': its taxels have positions, but the C code reads a grid: "
            f"export the program by its name for {rows}×{cols} cells, and interpolate before it."
        )
    program, driver = bound(program_of(scene.spec), scene.spec, scene.driver), scene.driver
    exported = export(
        program,
        precision=precision,
        method=method,
        needs=tuple(scene.plan.schedule.outputs),
        like=scene,
    )
    return with_scene(
        exported, scene.conversion, driver.channels, driver.unit, scene.rules, driver.rate
    )


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """Frames like those that a program will see.

    Attributes
    ----------
    shape : (rows, cols)
    channels : tuple of str
    rate : float, Hz
    unit : str
    measured : (frames, streams, rows, cols, channels) float
        Streams on which ranges are measured.
    simulated : bool
        Whether they are of the simulated array.
    """

    shape: Shape
    channels: tuple[str, ...]
    rate: float
    unit: str
    measured: Floats = field(repr=False)
    simulated: bool = False

    @classmethod
    def of(
        cls,
        like: object,
        shape: Sequence[int] | None,
        channels: Sequence[str] | None,
        rate: float | None,
    ) -> "Examples":
        """Return the frames of a recording, a file, an array or a scene, or simulated ones."""
        number = isinstance(cast("object", rate), int | float)
        if rate is not None and not (number and 0.0 < rate < np.inf):
            raise ArrayError(
                f"A rate must be a number of frames per second above 0, got {shown(rate)}."
            )
        if like is None:
            return cls._simulated(as_shape(shape or (8, 8)), channels, rate)
        if isinstance(like, str | PathLike):
            like = load_recording(cast("str", like))
        if isinstance(like, Scene):
            scene, values = like, list[Floats]()
            for moment in scene.results():  # a live array has no end
                values += [] if moment.values is None else [moment.values]
                if len(values) == MOST:
                    break
            names = scene.plan.schedule.channels_read
            unit = unit_of(scene.conversion, scene.driver)
            return cls._of(
                np.asarray(values), names, scene.driver.rate, unit, shape, channels, rate
            )
        if isinstance(like, Recording):
            known = (like.channels, like.rate, like.unit)
            return cls._of(np.asarray(like.values), *known, shape, channels, rate)
        frames = np.asarray(like, dtype=np.float64)
        last = frames.shape[-1] if frames.ndim == 4 else 1
        names = tuple(channels or (FORCE_AXES if last == 3 else ("normal",)))
        return cls._of(frames, names, rate or RATE, "", shape, channels, rate)

    @classmethod
    def _simulated(
        cls, shape: Shape, channels: Sequence[str] | None, rate: float | None
    ) -> "Examples":
        names = tuple(channels or FORCE_AXES)
        if names == (PICTURE,):
            return cls(shape, names, rate or RATE, GREY, pictures(shape))
        for name in names:
            if name not in FORCE_AXES:
                error = name_error("channel", name, FORCE_AXES)
                error.args = (f"{error} Give frames like those to come, which have others.",)
                raise error
        if rate is not None and rate > FASTEST:
            raise ArrayError(
                f"No streams are simulated at {shown(rate)} frames per second, which is more than "
                f"{FASTEST:,.0f}: give typical frames as 'like' (--like)."
            )
        places = [FORCE_AXES.index(name) for name in names]
        frames = measuring_frames(shape, rate or RATE)[..., places]
        return cls(shape, names, rate or RATE, SIMULATED, frames, simulated=True)

    @classmethod
    def _of(
        cls,
        frames: Floats,
        known: Sequence[str],
        usual: float,
        unit: str,
        shape: Sequence[int] | None,
        channels: Sequence[str] | None,
        rate: float | None,
    ) -> "Examples":
        if frames.ndim == 3:
            frames = frames[..., np.newaxis]
        if frames.ndim != 4 or not len(frames) or frames.shape[-1] != len(known):
            raise ArrayError(
                f"Expected frames (frames, rows, cols, {len(known)} channels) and at least one of "
                f"them, got {frames.shape}."
            )
        there = (int(frames.shape[1]), int(frames.shape[2]))
        if shape is not None and as_shape(shape) != there:
            raise ArrayError(
                f"The frames have {there[0]}×{there[1]} taxels, but the program is exported "
                f"for {shape[0]}×{shape[1]}: give frames of such an array, or leave out the "
                "shape."
            )
        names = tuple(channels or known)
        for name in names:
            if name not in known:
                raise name_error("channel", name, known)
        good = frames[np.isfinite(frames).all(axis=(1, 2, 3))][:MOST]
        picked = good[..., [list(known).index(name) for name in names]]
        if not len(picked):
            raise ArrayError("No frame has only finite numbers, so ranges cannot be measured.")
        return cls(there, names, rate or usual, unit, picked[:, np.newaxis].astype(np.float64))

    def frames_in(self, seconds: float) -> int:
        """Return the frames of a time, at 200 frames per second at least."""
        return round(seconds * max(self.rate, RATE))

    def parts(self, count: int) -> Floats:
        """Return streams among which a test vector is chosen, (count, streams, rows, cols, …)."""
        if self.simulated:
            places = [FORCE_AXES.index(name) for name in self.channels]
            return vector_streams(self.shape, count, self.rate)[..., places]
        one_after_another = self.measured.reshape(-1, *self.measured.shape[2:])
        return vector_parts([one_after_another], count)
