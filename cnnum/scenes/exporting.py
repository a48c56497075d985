"""Programs as C99 for a microcontroller: whose frames, at which rate, with which ranges."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats, Shape, as_shape
from cnnum.drivers.recording_file import load_recording
from cnnum.embedded.c.files import Exported, Facts
from cnnum.embedded.formats import precision_named
from cnnum.embedded.making import make
from cnnum.errors import ArrayError, SceneError, name_error
from cnnum.frame import FORCE_AXES
from cnnum.graph.schedule import schedule
from cnnum.programs import Program
from cnnum.recordings.recording import Recording
from cnnum.safety.names import shown
from cnnum.scenes.arrangement import bound, named, program_of
from cnnum.scenes.conversion import unit_of
from cnnum.scenes.pipeline import Scene
from cnnum.scenes.range_streams import APART, RATE, measuring_frames, vector_parts, vector_streams

SHORT, LONG = 48, 160
"""Frames of each stream of the test vector: long ones where they change more outputs."""

MOST = 3000
"""Frames of a recording that are looked at, from its start on."""

SIMULATED = "strain"


def export(
    program: Program | str,
    shape: Sequence[int] | None = None,
    *,
    precision: str = "q15",
    method: str = "auto",
    needs: Sequence[str] | None = None,
    channels: Sequence[str] | None = None,
    rate: float | None = None,
    like: "Recording | ArrayLike | str | PathLike[str] | Scene | None" = None,
) -> Exported:
    """Return a program as self-contained C99, with a test vector and a Makefile.

    Parameters
    ----------
    program : Program or str
        A program with its parameters, the name of one of the library, or "file.py:function".
    shape : (rows, cols), optional
        Unless given, that of `like`, or 8×8.
    precision : str
        "q15", "q7", another "qM.N", or "float32".
    method : "auto" or "euler"
        Exact products where possible, or Euler steps, for coupled cells.
    needs : sequence of str, optional
        Outputs; all unless given.
    channels : sequence of str, optional
        Channels of a frame, in their order. The default is those of `like`, or x, y and normal.
    rate : float, Hz, optional
        Frame rate, for a program that has times. The default is that of `like`, or 200.
    like : Recording, array, path or Scene, optional
        Typical frames, on which the range of every value is measured: a recording, its file, an
        array (frames, rows, cols, channels), or a scene, which is run to its end and calibrated.
        The default is strain of simulated scenes.

    Returns
    -------
    Exported
        `write(folder)` writes the files.

    Raises
    ------
    NotSupportedError
        If something in the program has no form in this precision.
    ArrayError
        If the frames do not fit the program.
    UnknownNameError
        If there is no such program, output, precision or channel.
    """
    found = named(program) if isinstance(program, str) else program
    seen = Examples.of(like, shape, channels, rate)
    timed = found if found.rate is not None else found.bind(rate=seen.rate)
    traced = timed.trace(seen.shape, seen.channels)
    wanted = schedule(traced, seen.channels, None if needs is None else tuple(needs))
    # frames of a program without memories need not follow each other
    streams = seen.measured[:: 1 if wanted.memories or not seen.simulated else APART]
    made = make(timed.name, wanted, precision_named(precision), streams, method)
    facts = Facts(traced.rate if traced.timed else None, seen.unit, precision, method)
    exported = made.export(seen.parts(SHORT), facts=facts)
    if exported.vector.still:
        longer = made.export(seen.parts(LONG), facts=facts)
        if len(longer.vector.still) < len(exported.vector.still):
            return longer
    return exported


def export_scene(scene: Scene, *, precision: str = "q15", method: str = "auto") -> Exported:
    """Return the program of a scene as C99: with its parameters, and the outputs that it wants.

    Ranges are measured on the scene's frames, calibrated as it says, to their end. The inputs of
    the C are calibrated values, in the unit that its header names.
    """
    if scene.grid is not None:
        rows, cols = scene.grid.shape
        raise SceneError(
            f"Scene '{scene.spec.name}': its taxels have positions, and C reads a grid: export the "
            f"program by its name for {rows}×{cols} cells, and interpolate before it."
        )
    program = bound(program_of(scene.spec), scene.spec, scene.driver)
    return export(
        program,
        precision=precision,
        method=method,
        needs=tuple(scene.plan.schedule.outputs),
        like=scene,
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
        for name in names:
            if name not in FORCE_AXES:
                error = name_error("channel", name, FORCE_AXES)
                error.args = (f"{error} Give frames like those to come, which have others.",)
                raise error
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

    def parts(self, count: int) -> Floats:
        """Return streams among which a test vector is chosen, (count, streams, rows, cols, …)."""
        if self.simulated:
            places = [FORCE_AXES.index(name) for name in self.channels]
            return vector_streams(self.shape, count, self.rate)[..., places]
        return vector_parts([self.measured[:, 0]], count)
