"""`cnnum studio`: a template at work in a browser, to change and to keep, or a program inside."""

import secrets
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cnnum.cli.commands.templates_convert import is_place
from cnnum.cli.options import (
    Changes,
    completed,
    json_option,
    page_options,
    scene_options,
    trust_option,
)
from cnnum.cli.output import COMPILING, Output, busy
from cnnum.cli.signals import stoppable

if TYPE_CHECKING:
    from cnnum.live.feeds import Feed
    from cnnum.live.server import Door, Place

SCENE_KEYS = {"array", "program", "needs"}
"""Keys of a scene that no template has."""


@click.command("studio")
@click.argument("source", default="EDGE", shell_complete=completed("template", files=True))
@click.option("--scene", help="Scene whose program runs on a recording; 'demo' by default.")
@click.option(
    "--live", help="Driver, scene or recording whose loads are the picture of a template."
)
@page_options(8766)
@scene_options
@trust_option
@json_option
def command(
    source: str,
    scene: str | None,
    live: str | None,
    host: str,
    port: int,
    token: str,
    changes: Changes,
    trust: bool,
    as_json: bool,
) -> int:
    """Edit a template in a browser and watch it run, or look into a program, until Ctrl-C.

    SOURCE is a template (of the library, or a file), a scene, a tactile program, a driver or a
    recording. The page of a template also finds weights for a rule, counts flips under mismatch,
    compares two templates, and saves TOML. The page of a program shows its graph and the result of
    each step, for every frame or, if it is a program of pictures, for the picture that you draw.
    Only this machine can reach the page; with --host, other machines can, but need a token.
    """
    from cnnum.cli.commands.view import feed_of
    from cnnum.live.server import Place, is_loopback, run, run_door

    if not is_loopback(host) and not token:
        token = secrets.token_urlsafe(12)
    where = Place(host, port, token)
    output = Output(as_json)

    def ready(address: str) -> None:
        output.record(
            {"kind": "studio", "address": address}, f"Open {address} in a browser; Ctrl-C ends it."
        )

    try:
        with stoppable():
            if is_of_program(source):
                if live is not None:
                    raise click.UsageError(f"'{source}' is no template: --live is of templates.")
                with busy(COMPILING, as_json=as_json):
                    feed = _feed(source, scene, changes, trust)
                run(feed, where, ready)
            else:
                if live is None and (scene is not None or changes or trust):
                    raise click.UsageError(
                        f"'{source}' is a template: --scene, --set and --trust are of programs, or "
                        "of --live."
                    )
                with busy(COMPILING, as_json=as_json):
                    sensed = None if live is None else feed_of(live, scene, changes, trust)
                    door = _studio(where, source, sensed)
                run_door(door, "the studio", ready, sensed)
    except KeyboardInterrupt:
        return 130
    return 0


def is_of_program(source: str) -> bool:
    """Return whether a source is a scene, a program, a driver or a recording, not a template."""
    from cnnum.drivers.registry import is_driver
    from cnnum.programs.library import program_names
    from cnnum.safety.reading import LARGEST, parse_toml, read_text
    from cnnum.scenes.scene_file import scene_names

    if source in (*scene_names(), *program_names()) or is_driver(source):
        return True
    path = Path(source)
    if path.suffix != ".toml":
        return is_place(source) and path.suffix not in (".tem", ".m", ".cnnsim")
    try:
        return bool(SCENE_KEYS & parse_toml(read_text(path, most=LARGEST)).keys())
    except (OSError, ValueError):
        return False  # what reads it as a template says why it cannot


def _feed(source: str, scene: str | None, changes: Changes, trust: bool) -> "Feed":
    """Return the feed of a program: one of pictures runs on what is drawn."""
    from cnnum.cli.commands.view import feed_of
    from cnnum.programs.library import program_names

    if source not in program_names("pictures"):
        return feed_of(*_scene_of(source, scene, changes), trust, inside=True)
    prefix = "program.parameters."
    if scene is not None or not all(key.startswith(prefix) for key in changes):
        raise click.UsageError(
            f"'{source}' runs on the picture that you draw: only --set {prefix}NAME=VALUE applies."
        )
    from cnnum.live.feeds import PictureFeed

    return PictureFeed(source, {key.removeprefix(prefix): v for key, v in changes.items()})


def _scene_of(
    source: str, scene: str | None, changes: Changes
) -> tuple[str, str | None, dict[str, object]]:
    """Return the source, scene and changes that show a program; one alone runs on the demo."""
    from cnnum.programs.library import program_names
    from cnnum.scenes.scene_file import scene_names

    if source in program_names() and source not in scene_names():
        return (
            scene or "demo",
            None,
            {"program": {"name": source}, "needs": ["everything"], **changes},
        )
    return source, scene, dict(changes)


def _studio(where: "Place", source: str, feed: "Feed | None") -> "Door":
    from cnnum.live.studio import Studio
    from cnnum.templating.files import load_entry
    from cnnum.templating.library import get_entry

    entry = load_entry(source) if is_place(source) else get_entry(source)
    return Studio(where, entry, feed)
