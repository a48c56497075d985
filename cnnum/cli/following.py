"""Following a scene or a hand: events as they come, fields into a file (`--save`), a summary."""

import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, cast

import click

from cnnum.cli.options import target_option, to_write
from cnnum.cli.output import Output, facts, progress, table
from cnnum.cli.signals import stoppable

if TYPE_CHECKING:
    from cnnum.graph.schedule import LeftOut
    from cnnum.scenes.events import Event
    from cnnum.scenes.frame_path import FrameResult
    from cnnum.scenes.hand import Hand
    from cnnum.scenes.pipeline import Scene
    from cnnum.scenes.scene_record import Summary


Watch = Callable[["FrameResult"], object]
"""Is given every moment of a scene."""

Write = Callable[[], object]

save_option = target_option(
    "--save",
    "FILE.npz|csv|nc|txt",
    "Write the scene's fields, one row per frame; .txt is for spikes, one per line.",
)


rerun_option = click.option(
    "--rerun",
    metavar="FILE.rrd|ADDRESS",
    help="Send pictures and events to Rerun: to a file or a running viewer.",
)

foxglove_option = click.option(
    "--foxglove",
    metavar="FILE.mcap|ADDRESS",
    help="Send pictures and events to Foxglove: to a file, or served at ws://127.0.0.1:8765.",
)


def _to_film(ctx: click.Context, parameter: click.Parameter, out: Path | None) -> Path | None:
    if out is not None:
        from cnnum.pictures import film_kind

        film_kind(out)
    return to_write(ctx, parameter, out)


film_option = click.option(
    "--film",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.gif|mp4|webm",
    callback=_to_film,
    help="Write a film of taxels and flags, with up to 25 pictures per second.",
)


class Kept:
    """Keeps the moments of a scene while it is followed, and writes a file of them at its end.

    Parameters
    ----------
    name : str
        Of the file in the summary.
    path : Path or None
        Nothing is kept without one.
    begin : callable
        Returns for the path what takes the moments, and what writes them there.
    """

    def __init__(
        self, name: str, path: Path | None, begin: Callable[[Path], tuple[Watch, Write]]
    ) -> None:
        self._name, self._path = name, path
        if path is not None:
            self._add, self._write = begin(path)

    def add(self, moment: "FrameResult") -> None:
        """Keep a moment."""
        if self._path is not None:
            self._add(moment)

    def write(self) -> Mapping[str, str]:
        """Write the file, and return its place for the summary."""
        if self._path is None:
            return {}
        self._write()
        return {self._name: str(self._path)}


def filmed(path: Path | None, scene: "Scene", *, force: bool = False) -> Kept:
    """Return what keeps a scene's moments for a film."""

    def begin(path: Path) -> tuple[Watch, Write]:
        from cnnum.report.films import write_scene_film
        from cnnum.report.record import SceneRecorder

        recorder = SceneRecorder(scene)
        return recorder.add, lambda: write_scene_film(path, recorder.record(), force=force)

    return Kept("film", path, begin)


def saved(path: Path | None, scene: "Scene", *, force: bool = False) -> Kept:
    """Return what keeps the fields that a scene wants.

    Raises
    ------
    SceneError
        If the scene wants no field.
    """

    def begin(path: Path) -> tuple[Watch, Write]:
        from cnnum.scenes.scene_record import SceneRecord, refuse_no_fields, refuse_no_spikes

        refuse_no_fields(scene.fields, scene.offered)
        refuse_no_spikes(path, scene.fields)
        record = SceneRecord(scene.fields)
        return record.add, lambda: record.save(path, force=force)

    return Kept("saved", path, begin)


def kept(*writers: Callable[[], Mapping[str, str]]) -> Callable[[], Mapping[str, str]]:
    """Return the function that calls all writers, and joins their results."""
    return lambda: {key: place for write in writers for key, place in write().items()}


@contextmanager
def to_viewers(
    scene: "Scene", *, rerun: str | None, foxglove: str | None, force: bool
) -> Generator[Watch]:
    """Yield the function that sends a moment to the viewers that have a target."""
    with ExitStack() as sinks:
        watches = list[Watch]()
        if rerun is not None or foxglove is not None:
            from cnnum.live.foxglove_sink import FoxgloveSink
            from cnnum.live.rerun_sink import RerunSink

            for kind, target in ((RerunSink, rerun), (FoxgloveSink, foxglove)):
                if target is not None:
                    watches.append(sinks.enter_context(kind(scene, target, force=force)).add)
        yield watching(*watches)


def refuse_unknown(save: Path | None) -> None:
    """Refuse a file of fields of an unknown kind, before the work.

    Raises
    ------
    UnknownNameError
    """
    if save is not None:
        from cnnum.scenes.scene_record import suffix_of

        suffix_of(save)


def watching(*watchers: Watch) -> Watch:
    """Return the function that gives every moment to all watchers."""

    def watch(moment: "FrameResult") -> None:
        for watcher in watchers:
            watcher(moment)

    return watch


STOPPED = 130
"""Exit code after Ctrl-C, SIGTERM or SIGHUP."""


def follow(
    scene: "Scene",
    output: Output,
    *,
    frames: int | None = None,
    begin: float = 0.0,
    watch: Watch | None = None,
    finish: Callable[[], Mapping[str, str]] | None = None,
    keep: Callable[[], Mapping[str, str]] | None = None,
) -> int:
    """Run a scene to its end, print events and the summary, and return the exit code.

    Parameters
    ----------
    scene : Scene
    output : Output
    frames : int, optional
        To stop after.
    begin : float
        s after the first frame; frames before it run silently.
    watch : callable, optional
        Is given every moment.
    finish : callable, optional
        Is called when the scene has ended by itself; its results, by name, go into the
        summary.
    keep : callable, optional
        The same, but called however the scene has ended, if there is anything to keep: not where
        the whole source lies before `begin`.
    """
    from cnnum.scenes.bad_taxels import GapWatch
    from cnnum.scenes.scene_file import EVERYTHING

    known = getattr(scene.driver, "total_frames", None)
    total = min((n for n in (frames, known) if n is not None), default=None)
    code, more, gaps = 0, dict[str, str](), GapWatch()
    shown = scene.fields if output.as_json and EVERYTHING not in scene.spec.needs else ()
    try:
        with (
            stoppable(),
            progress("frames", total, as_json=output.as_json) as steps,
            closing(cast("Generator[FrameResult, None, None]", scene.results(begin))) as moments,
        ):
            for count, moment in enumerate(moments, 1):
                if count == 1 and scene.last_before is not None:
                    gaps.seen(moment.number - 1, scene.last_before)
                gap = gaps.seen(moment.number, moment.frame)
                if gap is not None:
                    output.record(gap.record(), str(gap))
                for event in moment.events:
                    output.record(event.record(), event_text(event))
                if shown and moment.outputs:
                    _show_fields(output, moment, shown)
                if moment.error is not None:
                    _name_bad(scene, output, moment.number)
                if watch is not None:
                    watch(moment)
                steps.advance()
                if frames is not None and count >= frames:
                    break
        _refuse_nothing_shown(scene, begin)
        more |= finish() if finish is not None else {}
    except KeyboardInterrupt:
        code = STOPPED
    finally:
        # also after an error: the summary before it is not lost
        if not isinstance(sys.exc_info()[1], BrokenPipeError):
            if keep is not None and not _shows_nothing(scene):
                more |= keep()
            summarise(scene, output, more)
    return code


def follow_hand(hand: "Hand", output: Output, *, name: str, frames: int | None = None) -> int:
    """Run a hand to its end, print the events of its skins and a summary, and return the exit code.

    Parameters
    ----------
    hand : Hand
    output : Output
    name : str
        Of the hand, for the summary.
    frames : int, optional
        Steps to stop after.
    """
    from cnnum.scenes.bad_taxels import GapWatch

    code, wide = 0, max(map(len, hand))
    gaps = {skin: GapWatch() for skin in hand}
    try:
        with (
            stoppable(),
            progress("steps", frames, as_json=output.as_json) as steps,
            closing(hand.results()) as results,
        ):
            for result in results:
                for skin, moment in result.skins.items():
                    gap = gaps[skin].seen(moment.number, moment.frame)
                    if gap is not None:
                        output.record({"skin": skin} | gap.record(), f"{skin:{wide}}  {gap}")
                    for event in moment.events:
                        line = f"{skin:{wide}}  {event_text(event)}"
                        output.record({"skin": skin} | event.record(), line)
                    if moment.error is not None:
                        _name_bad(hand[skin], output, moment.number, skin)
                steps.advance()
                if frames is not None and result.number + 1 >= frames:
                    break
    except KeyboardInterrupt:
        code = STOPPED
    finally:
        if not isinstance(sys.exc_info()[1], BrokenPipeError):
            _summarise_hand(hand, output, name)
    return code


def _summarise_hand(hand: "Hand", output: Output, name: str) -> None:
    """Print the last line of a hand's run: its steps, and the frames of each skin."""
    seen = hand.summary()
    output.record(
        {
            "kind": "summary",
            "hand": name,
            "steps": seen.steps,
            "waiting": seen.waiting,
            "dropped": seen.dropped,
            "p50_us": round(seen.p50_us, 3),
            "p99_us": round(seen.p99_us, 3),
            "launches": hand.launches,
            "skins": {skin: _frame_counts(own) for skin, own in seen.skins.items()},
        }
    )
    skins = table("skin", ">frames", ">bad", ">dropped", ">repeated", ">saturated", ">masked")
    for skin, own in seen.skins.items():
        counts = (own.frames, own.bad_frames, own.dropped, own.repeated, own.saturated, own.masked)
        skins.add_row(skin, *map(str, counts))
    pairs = [
        ("steps", f"{seen.steps}, of {hand.launches} launches where all skins have a frame"),
        ("a step", f"{seen.p50_us:.0f} µs (99 %: {seen.p99_us:.0f} µs)"),
    ]
    if seen.dropped:
        pairs.append(("lost", f"{seen.dropped} frames, for which the hand was too slow"))
    output.show("", skins, facts(pairs))


def _refuse_nothing_shown(scene: "Scene", begin: float) -> None:
    """Say that the whole source lies before the part that was asked for."""
    from cnnum.errors import SceneError

    if _shows_nothing(scene):
        raise SceneError(
            f"No frame is left from {begin:g} s on: the last frame of scene '{scene.spec.name}' "
            f"comes {scene.seconds_before:g} s after its first."
        )


def _shows_nothing(scene: "Scene") -> bool:
    """Return whether frames ran silently, and none after them."""
    return scene.last_before is not None and not scene.summary().frames


def _saturated_text(count: int) -> str:
    return f", {count} saturated: loads in them are lower bounds" if count else ""


def _show_fields(output: Output, moment: "FrameResult", names: Sequence[str]) -> None:
    """Print a record for each field of a frame that the scene wants by name."""
    for name in names:
        value = moment.outputs[name].tolist()
        record: dict[str, object] = {
            "t": round(moment.frame.time, 6),
            "kind": "field",
            "frame": moment.number,
        }
        if moment.load_is_bound:
            record["load_is_bound"] = True
        output.record(record | {"name": name, "value": value})


def _name_bad(scene: "Scene", output: Output, number: int, skin: str = "") -> None:
    """Print the record of a bad frame, if it is one of those that are named."""
    named = scene.bad.named
    if named is not None and named.frame == number:
        whose = {"skin": skin} if skin else {}
        output.record(whose | named.record())  # in words it stands on standard error already


def event_text(event: "Event") -> str:
    """Return an event as a line of aligned columns."""
    parts = [f"{event.time:9.3f} s  {event.title:<15}"]
    if event.place is not None:
        parts.append(f"x {event.place[0]:5.1f} mm, y {event.place[1]:5.1f} mm")
    elif event.where is not None:
        parts.append(f"row {event.where[0]:4.1f}, column {event.where[1]:4.1f}")
    if event.direction is not None:
        parts.append(f"direction {degrees(event.direction):6.1f}°")
    if event.sense:
        parts.append(event.turn(" → "))
    return "  ".join([*parts, *event.further()])


def _frame_counts(seen: "Summary") -> dict[str, object]:
    """Return what became of the frames of a scene, for its record."""
    return {
        "frames": seen.frames,
        "before": seen.before,
        "bad_frames": seen.bad_frames,
        "sent": seen.sent,
        "handed_on": seen.handed_on,
        "dropped": seen.dropped,
        "skipped": seen.skipped,
        "refused": seen.refused,
        "repeated": seen.repeated,
        "saturated": seen.saturated,
        "masked": seen.masked,
        "dropouts": seen.dropouts,
        "gaps": seen.counters.gaps,
        "longest_gap_s": round(seen.longest_gap, 6),
    }


def summarise(scene: "Scene", output: Output, more: Mapping[str, str]) -> None:
    """Print the last line of a run."""
    seen, left_out = scene.summary(), scene.plan.explain().left_out
    gaps, longest_gap = seen.counters.gaps, seen.longest_gap
    record = {
        "kind": "summary",
        "scene": scene.spec.name,
        **_frame_counts(seen),
        "p50_us": round(seen.p50_us, 3),
        "p99_us": round(seen.p99_us, 3),
        "arrival_p50_us": seen.arrival_p50_us,
        "arrival_p99_us": seen.arrival_p99_us,
        "engine": scene.engine.name,
        "device": scene.engine.device,
        "precision": scene.engine.precision,
        "left_out": left_out_records(left_out),
        **more,
    }
    output.record(record)
    output.show(
        "",
        facts(
            (
                (
                    "frames",
                    f"{seen.frames} ({seen.bad_frames} bad, {seen.dropped} dropped, "
                    f"{seen.repeated} repeated{_saturated_text(seen.saturated)})",
                ),
                (
                    "scans",
                    f"{seen.sent} sent = {seen.handed_on} handed on + {seen.dropped} dropped + "
                    f"{seen.skipped} skipped + {seen.refused} refused",
                ),
                *_before_facts(seen),
                *_gap_facts(gaps, longest_gap),
                ("a frame", f"{seen.p50_us:.0f} µs (99 %: {seen.p99_us:.0f} µs)"),
                *_arrival_facts(seen),
                ("device", f"{scene.engine.device}, {scene.engine.name}, {scene.engine.precision}"),
                ("left out", f"{len(left_out)} of the program's parts ('cnnum plan' lists them)"),
                *more.items(),
            )
        ),
    )


def _arrival_facts(seen: "Summary") -> list[tuple[str, str]]:
    """Return a row on the way from a port to events, where frames came over one."""
    if seen.arrival_p99_us is None:
        return []
    median, late = seen.arrival_p50_us or 0.0, seen.arrival_p99_us
    return [("arrival", f"{median:.0f} µs from the port to its events (99 %: {late:.0f} µs)")]


def _before_facts(seen: "Summary") -> list[tuple[str, str]]:
    """Return a row on frames that ran silently, where there are any."""
    return [("before", f"{seen.before} frames ran silently")] if seen.before else []


def _gap_facts(gaps: int, longest: float) -> list[tuple[str, str]]:
    """Return a row on missed frames, where there are any."""
    if not gaps and not longest:
        return []
    return [("gaps", f"{gaps} of the connection; the longest without a frame {longest:.3f} s")]


def left_out_records(left_out: "tuple[LeftOut, ...]") -> list[dict[str, object]]:
    """Return the operations that a plan leaves out, as records."""
    return [
        {"what": x.what, "why": x.why, "saves": x.saves, "bytes": x.bytes, "flops": x.flops}
        for x in left_out
    ]
