"""`cnnum view`: a live page of an array, a scene or a recording, in a browser."""

import secrets
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

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
    from cnnum.scenes.pipeline import Scene
    from cnnum.scenes.scene_file import SceneSpec

SHOWN = (
    ("contact_map", "bump_contact", "load_normal", "twist"),
    ("contact_map", "load_normal"),
    (),
)
"""Fields that the page draws; as many as a scene's program gives are added to its wants."""


@click.command("view")
@click.argument("source", shell_complete=completed("scene", files=True))
@click.option(
    "--scene",
    help="Scene to run on a recording; required for raw counts, otherwise 'demo' by default.",
)
@page_options(8765)
@scene_options
@trust_option
@json_option
def command(
    source: str,
    scene: str | None,
    host: str,
    port: int,
    token: str,
    changes: Changes,
    trust: bool,
    as_json: bool,
) -> int:
    """Show SOURCE (a scene, the name of a driver, or a recording) in a browser, until Ctrl-C.

    Only this machine can reach the page; with --host, other machines can, but need a token. A scene
    adds events and outlines to the readings. --set changes keys of the scene or options of the
    driver.
    """
    from cnnum.live.server import Place, is_loopback, run

    if not is_loopback(host) and not token:
        token = secrets.token_urlsafe(12)
    where = Place(host, port, token)
    with busy(COMPILING, as_json=as_json):
        feed = feed_of(source, scene, changes, trust)
    output = Output(as_json)

    def ready(address: str) -> None:
        output.record(
            {"kind": "view", "address": address}, f"Open {address} in a browser; Ctrl-C ends it."
        )

    try:
        with stoppable():
            run(feed, where, ready)
    except KeyboardInterrupt:
        return 130
    return 0


def feed_of(
    source: str, scene: str | None, changes: dict[str, Any], trust: bool, *, inside: bool = False
) -> "Feed":
    """Return the feed of a source; `inside` with the result of every operation of its program."""
    from cnnum.cli.options import open_source, usual_scene
    from cnnum.drivers.recording_file import array_of
    from cnnum.drivers.registry import is_driver
    from cnnum.live.feeds import ArrayFeed, RecordingFeed, SceneFeed
    from cnnum.scenes.scene_file import scene_names

    if is_driver(source):
        options = {key.removeprefix("array."): value for key, value in changes.items()}
        return ArrayFeed(source, open_source(source, options))
    if source in scene_names() or source.endswith(".toml"):
        return SceneFeed(_scene(source, changes, trust, inside), inside=inside)
    array = array_of(Path(source))
    chosen = scene or usual_scene(Path(source), array, changes, "demo")
    opened = _scene(chosen, {"array": array} | changes, trust, inside)
    return RecordingFeed(opened, inside=inside)


def _scene(name: str, changes: dict[str, Any], trust: bool, inside: bool) -> "Scene":
    """Return a scene that also gives the fields of the page, as far as its program has it."""
    from cnnum.engine import Engine
    from cnnum.errors import SceneError, UnknownNameError
    from cnnum.scenes.pipeline import load_scene
    from cnnum.scenes.scene_file import read_scene

    spec = read_scene(name, changes=changes, trust=trust)
    # hundreds of outputs are compiled in seconds by this one, and by OpenCL in minutes
    engine = Engine("numba") if inside and spec.engine is None else None
    why = _read_outs(spec)
    for more in dict.fromkeys(((*SHOWN[0], *why), (*SHOWN[1], *why), why, *SHOWN[:-1])):
        try:
            every = list(dict.fromkeys((*spec.needs, *more)))
            opened = load_scene(
                name, changes=changes | {"needs": every}, trust=trust, engine=engine
            )
            break
        except (SceneError, UnknownNameError):
            continue  # the program lacks one of them
    else:
        opened = load_scene(name, changes=changes, trust=trust, engine=engine)
    if inside:
        opened.keep_everything()
    return opened


def _read_outs(spec: "SceneSpec") -> tuple[str, ...]:
    """Return the outputs behind the slips and twists that a scene wants; none of other programs."""
    from cnnum.errors import CnnumError
    from cnnum.frame import FORCE_AXES
    from cnnum.scenes.arrangement import program_of
    from cnnum.scenes.explaining import explained_kinds, read_outs_of

    program = program_of(spec)
    given = {k: v for k, v in spec.parameters.items() if k in ("axes", "pads")}
    pads = given.get("pads", 1)
    try:
        shape = (8, 8 * (pads if isinstance(pads, int) else 1))
        outputs = program.bind(**given, rate=100.0).trace(shape, FORCE_AXES).outputs
    except CnnumError:
        return ()
    kinds = [kind for kind in explained_kinds(outputs) if kind in spec.needs]
    return tuple(read_outs_of(kinds, outputs))
