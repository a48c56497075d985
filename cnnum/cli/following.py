"""Following a scene: its events as they come, and the summary of what was seen."""

import sys
from collections.abc import Callable, Generator, Mapping
from contextlib import closing
from math import degrees
from typing import TYPE_CHECKING, cast

from cnnum.cli.output import Output, facts
from cnnum.cli.progress import progress

if TYPE_CHECKING:
    from cnnum.events import Event
    from cnnum.graph.schedule import LeftOut
    from cnnum.pipeline import Moment, Scene

STOPPED = 130
"""Exit code after Ctrl-C."""


def follow(
    scene: "Scene",
    output: Output,
    *,
    frames: int | None = None,
    watch: Callable[["Moment"], object] | None = None,
    finish: Callable[[], Mapping[str, str]] | None = None,
) -> int:
    """Run a scene to its end, print events and the summary, and return the exit code.

    Parameters
    ----------
    scene : Scene
    output : Output
    frames : int, optional
        To stop after.
    watch : callable, optional
        Is given every moment.
    finish : callable, optional
        Is called when the scene has ended by itself; what it returns, by name, goes into the
        summary.
    """
    known = getattr(scene.driver, "total_frames", None)
    total = min((n for n in (frames, known) if n is not None), default=None)
    code, more = 0, dict[str, str]()
    try:
        with (
            progress("frames", total, as_json=output.as_json) as steps,
            closing(cast("Generator[Moment, None, None]", scene.moments())) as moments,
        ):
            for moment in moments:
                for event in moment.events:
                    output.record(event.record(), event_text(event))
                if watch is not None:
                    watch(moment)
                steps.advance()
                if frames is not None and moment.number + 1 >= frames:
                    break
        more |= finish() if finish is not None else {}
    except KeyboardInterrupt:
        code = STOPPED
    finally:
        # also after an error: what was seen before it is not lost
        if not isinstance(sys.exc_info()[1], BrokenPipeError):
            summarise(scene, output, more)
    return code


def event_text(event: "Event") -> str:
    """Return an event as a line of aligned columns."""
    kind = f"{event.phase} {event.kind}" if event.phase else event.kind
    parts = [f"{event.t:9.3f} s  {kind:<15}"]
    if event.where is not None:
        parts.append(f"row {event.where[0]:4.1f}, column {event.where[1]:4.1f}")
    if event.direction is not None:
        parts.append(f"direction {degrees(event.direction):6.1f}°")
    if event.sense:
        parts.append("x → y" if event.sense > 0 else "y → x")
    if event.strength is not None:
        parts.append(f"strength {event.strength:.3g}")
    return "  ".join(parts)


def summarise(scene: "Scene", output: Output, more: Mapping[str, str]) -> None:
    """Print the last line of a run."""
    seen, left_out = scene.summary(), scene.plan.explain().left_out
    counters = seen.counters
    record = {
        "kind": "summary",
        "scene": scene.spec.name,
        "frames": seen.frames,
        "bad_frames": seen.bad_frames,
        "dropped": counters.dropped,
        "repeated": seen.repeated,
        "skipped": counters.skipped,
        "p50_us": round(seen.p50_us, 3),
        "p99_us": round(seen.p99_us, 3),
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
                    f"{seen.frames} ({seen.bad_frames} bad, {counters.dropped} dropped, "
                    f"{seen.repeated} repeated)",
                ),
                ("a frame", f"{seen.p50_us:.0f} µs (99 %: {seen.p99_us:.0f} µs)"),
                ("device", f"{scene.engine.device}, {scene.engine.name}, {scene.engine.precision}"),
                ("left out", f"{len(left_out)} of the program's parts ('cnnum plan' lists them)"),
                *more.items(),
            )
        ),
    )


def left_out_records(left_out: "tuple[LeftOut, ...]") -> list[dict[str, object]]:
    """Return what a plan leaves out, as records."""
    return [
        {"what": x.what, "why": x.why, "saves": x.saves, "bytes": x.bytes, "flops": x.flops}
        for x in left_out
    ]
