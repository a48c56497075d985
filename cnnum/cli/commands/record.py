"""`cnnum record`: an array's frames to a file."""

import time
from collections.abc import Generator, Mapping
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cnnum.cli.options import (
    assignments,
    completed,
    frames_option,
    is_hand_file,
    json_option,
    limited,
    open_source,
    scene_text,
    seconds_option,
    setting_option,
    trust_option,
)
from cnnum.cli.output import Output, progress, quantity
from cnnum.cli.signals import stoppable, undisturbed
from cnnum.errors import CnnumError, RecordingError
from cnnum.frame import Frame
from cnnum.recordings.export import export, suffix_of
from cnnum.recordings.journal import Journal
from cnnum.recordings.layout import CALIBRATION, SCENE, Held
from cnnum.recordings.reader import look
from cnnum.safety.files import beside, named_after, put, refuse_target, sentences, taken

if TYPE_CHECKING:
    from cnnum.drivers.driver import Driver
    from cnnum.tactile.taxel import Calibration


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a recording ended.

    Attributes
    ----------
    file : Path
        Where the frames are.
    frames, lost : int
        Those that are kept, and those that had come and are not.
    problem : str
        The error in a sentence; empty where there is none.
    """

    file: Path
    frames: int
    lost: int
    problem: str = ""


class Recorder:
    """A recording in the making.

    MCAP is written under its own name from the first frame on. Any other kind of file, and one
    that replaces another, is a journal at first: a file of its own, which can be read as well.

    Parameters
    ----------
    target : Path
        Its suffix says the kind.
    driver : Driver
    force : bool
        Whether a file that is there already is replaced, when the recording is complete.
    scene : str
        Text of the scene whose array it is; empty where there is none.
    raw : bool
        Whether an MCAP file also holds the bytes as they come from a port.

    Attributes
    ----------
    driver : Driver

    Raises
    ------
    UnknownNameError
        If the suffix is none that is known.
    RecordingError
        If there is such a file already, or it cannot be written.
    """

    def __init__(
        self,
        target: Path,
        driver: "Driver",
        *,
        force: bool = False,
        scene: str = "",
        raw: bool = False,
    ) -> None:
        self._target, self._force, self.driver = target, force, driver
        # a file at this name, also a link to nowhere, is not ours to touch
        there = target.exists() or target.is_symlink()
        refuse_target(target, error=RecordingError, force=force)
        direct = suffix_of(target) == ".mcap" and not there
        path = target if direct else journal_of(target)
        calibration = getattr(driver, "calibration", None)
        try:
            held = _held(calibration, scene)
            self._journal = Journal(
                path, driver.rate, calibration, held, getattr(driver, "pads", None)
            )
        except FileExistsError:
            raise taken(path, RecordingError) if direct else _unfinished(path, target) from None
        except OSError as error:
            raise RecordingError(
                f"'{target}' cannot be written: {error.strerror}; choose an existing folder in "
                "which you may write."
            ) from None
        tap = getattr(driver, "tap", None)
        if tap is not None:
            tap(self._journal.add_raw if raw and suffix_of(target) == ".mcap" else None)

    def add(self, frame: Frame) -> None:
        """Take in a frame.

        Raises
        ------
        RecordingError
            If there is no room for more, or the frame is of another shape than those before.
        """
        self._journal.add(frame)

    def finish(self) -> Outcome:
        """Close the file, or write the one that was asked for; no frame is ever removed."""
        journal, to_mcap = self._journal, suffix_of(self._target) == ".mcap"
        journal.close(index=to_mcap)
        kept, lost = journal.stored, journal.came - journal.stored
        problem = ""
        if kept and journal.failure is not None:
            problem = self._full(journal.failure, kept, lost)
        elif journal.failure is not None:
            problem = (
                f"'{self._target}' cannot be written ({_why(journal.failure)}): none of {lost} "
                "frames is kept; choose a folder that has room."
            )
        elif kept and journal.path != self._target:
            problem = self._place(to_mcap)
        gone = not kept or not (problem or journal.path == self._target)
        return Outcome(self._target if gone else journal.path, kept, lost, problem)

    def _place(self, to_mcap: bool) -> str:
        """Put the file in its place; return the error."""
        path, target = self._journal.path, self._target
        try:
            if to_mcap:
                with sentences(target, RecordingError):
                    put(path, target, force=self._force)
            else:
                export(look(path), target, force=self._force)
                path.unlink()
        except (CnnumError, OSError) as error:
            said = str(error) if isinstance(error, CnnumError) else f"{_why(error)}."
            return (
                f"'{target}' was not made, and its {self._journal.stored} frames are kept in "
                f"'{path}': 'cnnum recover {path} OUT' makes a file of them; {said}"
            )
        return ""

    def _full(self, failure: OSError, kept: int, lost: int) -> str:
        path = self._journal.path
        return (
            f"'{path}' takes no more ({_why(failure)}): {kept} frames are kept in it, {lost} that "
            f"had come are not; 'cnnum recover {path} OUT' makes a whole file where there is room."
        )


def _held(calibration: "Calibration | None", scene: str) -> list[Held]:
    """Return the files that travel in a recording."""
    texts = {CALIBRATION: calibration.to_text() if calibration else "", SCENE: scene}
    return [Held(name, text, time.time_ns()) for name, text in texts.items() if text]


def journal_of(target: Path) -> Path:
    """Return the name of the journal of a file that is not written directly."""
    return beside(target, ".recording.mcap")


def _unfinished(path: Path, target: Path) -> RecordingError:
    return RecordingError(
        f"'{path}' is an unfinished recording: rescue it with 'cnnum recover {path} OUT' and "
        f"remove it, or choose another name than '{target}'."
    )


def _why(error: OSError) -> str:
    return str(error.strerror or error)


@click.command("record")
@click.argument("source", shell_complete=completed("scene", files=True))
@click.argument("file", type=click.Path(path_type=Path))
@setting_option("Set an option of the driver; may be repeated.")
@seconds_option
@frames_option
@click.option("--force", is_flag=True, help="Replace FILE if it exists.")
@click.option("--raw/--no-raw", default=True, help="Also keep the bytes of the port (.mcap only).")
@trust_option
@json_option
def command(
    source: str,
    file: Path,
    settings: tuple[str, ...],
    seconds: float | None,
    frames: int | None,
    force: bool,
    raw: bool,
    trust: bool,
    as_json: bool,
) -> int:
    """Record the frames of the array SOURCE (a driver's name, a scene or a hand) to FILE.

    Each skin of a hand gets a file of its own, such as FILE-thumb.mcap for FILE.mcap. FILE
    ends in .mcap (also for Foxglove), .npz (NumPy), .h5 (HDF5) or .csv. Frames are on disk within
    a second, and `cnnum recover` rescues a file that was cut off. The recording ends at --seconds
    or --frames, on Ctrl-C, or when the array goes away.
    """
    suffix_of(file)  # before the array is opened
    given, output = assignments(settings), Output(as_json)
    if not is_hand_file(source):
        with open_source(source, given, trust=trust) as driver:
            recorders = recorders_of(source, {file: driver}, force=force, raw=raw)
            steps = ({"": frame} for frame in driver.frames())
            return _fill({"": recorders[0]}, steps, output, seconds, frames)
    from cnnum.scenes.hand import load_hand

    changes = {f"array.{key}": value for key, value in given.items()}
    with load_hand(source, changes=changes, trust=trust) as hand:
        targets: dict[Path, Driver] = {}
        for skin in hand:
            own = named_after(file.parent, skin, file.suffix).name
            target = file.with_name(f"{file.stem}-{own}")
            if target in targets:
                raise RecordingError(f"Two skins of '{source}' would have the file '{target}'.")
            targets[target] = hand[skin].driver
        recorders = recorders_of(source, targets, force=force, raw=raw)
        named = dict(zip(hand, recorders, strict=True))
        code = _fill(named, hand.frames(), output, seconds, frames)
        lost = hand.summary().dropped
    if lost:
        raise RecordingError(f"{lost} frames were lost, because this machine was too slow.")
    return code


def recorders_of(
    source: str, targets: Mapping[Path, "Driver"], *, force: bool, raw: bool
) -> list[Recorder]:
    """Return a recorder for each file; none is left if one cannot be made."""
    scene = scene_text(source)
    with ExitStack() as undone:
        recorders = list[Recorder]()
        for target, driver in targets.items():
            recorders.append(Recorder(target, driver, force=force, scene=scene, raw=raw))
            undone.callback(recorders[-1].finish)
        undone.pop_all()
    return recorders


def _fill(
    recorders: Mapping[str, Recorder],
    steps: Generator[Mapping[str, Frame], None, None],
    output: Output,
    seconds: float | None,
    frames: int | None,
) -> int:
    """Record steps, at most one frame of each array, and return the exit code.

    Raises
    ------
    RecordingError
        If a file could not be written, or an array had no frame; what came is kept.
    """
    stopped, unit = True, "frames" if len(recorders) == 1 else "steps"
    try:
        with suppress(KeyboardInterrupt), stoppable() as stop:
            with progress(unit, frames, as_json=output.as_json) as shown, closing(steps):
                for step in limited(steps, seconds, frames):
                    with stop.shield():  # half a frame would spoil the file
                        for name, frame in step.items():
                            recorders[name].add(frame)
                    shown.advance()
            stopped = False
    finally:
        with undisturbed():
            outcomes = {name: recorder.finish() for name, recorder in recorders.items()}
        for name, outcome in outcomes.items():
            if outcome.frames:  # also where the array went away: the kept frames are counted
                _report(output, outcome, recorders[name].driver, name)
        problems = [outcome.problem for outcome in outcomes.values() if outcome.problem]
        if problems:
            raise RecordingError("; ".join(problems))
    empty = [f"'{outcome.file}'" for outcome in outcomes.values() if not outcome.frames]
    if empty:
        raise RecordingError(f"Nothing was recorded to {', '.join(empty)}: no frame arrived.")
    return 130 if stopped else 0


def _report(output: Output, outcome: "Outcome", driver: "Driver", skin: str = "") -> None:
    counters, size = driver.counters, outcome.file.stat().st_size
    output.record(
        ({"skin": skin} if skin else {})
        | {
            "kind": "recording",
            "file": str(outcome.file),
            "frames": outcome.frames,
            "lost": outcome.lost,
            "bad_frames": counters.bad,
            "dropped": counters.dropped,
            "repeated": counters.repeated,
            "gaps": counters.gaps,
            "bytes": size,
        },
        f"{outcome.frames} frames in '{outcome.file}' ({quantity(size, 'B')}); {counters.bad} bad, "
        f"{counters.dropped} dropped, {counters.repeated} repeated",
    )
