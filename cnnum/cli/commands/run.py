"""`cnnum run`: a scene or a hand, its events as they come, and a summary."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cnnum.cli import following
from cnnum.cli.following import follow
from cnnum.cli.options import (
    Changes,
    completed,
    force_option,
    frames_option,
    json_option,
    scene_options,
    target_option,
    trust_option,
)
from cnnum.cli.output import COMPILING, Output, busy
from cnnum.safety.values import visible

if TYPE_CHECKING:
    from cnnum.scenes.frame_path import FrameResult
    from cnnum.scenes.hand import Hand
    from cnnum.scenes.pipeline import Scene


@click.command("run")
@click.argument("scene", shell_complete=completed("scene", files=True))
@scene_options
@trust_option
@following.save_option
@following.film_option
@following.rerun_option
@following.foxglove_option
@frames_option
@target_option(
    "--trace",
    "FILE.html",
    "Write a page with a picture of every operation's result on one frame.",
)
@click.option(
    "--trace-frame",
    type=click.IntRange(min=0),
    help="Number of that frame, from 0; by default that of the first event.",
)
@force_option
@json_option
def command(
    scene: str,
    changes: Changes,
    save: Path | None,
    film: Path | None,
    rerun: str | None,
    foxglove: str | None,
    frames: int | None,
    trace: Path | None,
    trace_frame: int | None,
    trust: bool,
    force: bool,
    as_json: bool,
) -> int:
    """Run SCENE (a TOML file, or the name of a packaged scene) and print its events.

    A file with tables [skin.NAME] is a hand: each event comes with the name of its skin.

    Ctrl-C (or SIGTERM, SIGHUP) stops the run and prints the summary.
    """
    _refuse_trace(trace, trace_frame)
    following.refuse_unknown(save)
    output = Output(as_json)
    with busy(COMPILING, as_json=as_json):
        from cnnum.scenes.pipeline import load_scene
        from cnnum.scenes.scene_file import is_hand

        if is_hand(scene):
            asked = {
                "--save": save,
                "--rerun": rerun,
                "--foxglove": foxglove,
                "--trace": trace,
                "--film": film,
            }
            hand = _hand(scene, changes, trust, asked)
            return following.follow_hand(hand, output, name=scene, frames=frames)
        loaded = load_scene(scene, changes=changes, trust=trust)
    saver = following.saved(save, loaded, force=force)
    filmed = following.filmed(film, loaded, force=force)
    eventful: list[int] = []

    def watch(moment: "FrameResult") -> None:
        if moment.events and not eventful:
            eventful.append(moment.number)

    with following.to_viewers(loaded, rerun=rerun, foxglove=foxglove, force=force) as send:
        watches = following.watching(watch, saver.add, filmed.add, send)
        code = follow(
            loaded,
            output,
            frames=frames,
            watch=watches,
            keep=following.kept(saver.write, filmed.write),
        )
    if trace is None:
        return code
    number = trace_frame if trace_frame is not None else next(iter(eventful), 0)
    if getattr(loaded.driver, "live", False):  # the frames of its pass are gone
        loaded = load_scene(scene, changes=changes, trust=trust)
    _write_trace(trace, loaded, number, force)
    click.echo(visible(f"Written: {trace} (frame {number})"), err=as_json)
    return code


def _hand(scene: str, changes: Changes, trust: bool, asked: Mapping[str, object]) -> "Hand":
    """Open a hand, unless options are given that are those of one scene."""
    from cnnum.scenes.hand import load_hand

    for option in (name for name, value in asked.items() if value is not None):
        raise click.UsageError(f"{option} is for one scene, and '{scene}' is a hand of skins.")
    hand = load_hand(scene, changes=changes, trust=trust)
    hand.warm_up()
    return hand


def _refuse_trace(page: Path | None, frame: int | None) -> None:
    if page is None and frame is not None:
        raise click.UsageError("--trace-frame requires --trace FILE.html.")
    if page is not None and page.suffix.lower() not in {".html", ".htm"}:
        raise click.UsageError(
            f"--trace writes an HTML page: expected FILE.html, got '{page.name}'."
        )


def _write_trace(path: Path, scene: "Scene", number: int, force: bool) -> None:
    from cnnum.report.run_pages import write_trace_page

    steps = scene.trace(number)
    write_trace_page(path, f"{scene.spec.name}, frame {number}", steps, force=force)
