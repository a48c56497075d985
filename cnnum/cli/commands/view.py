"""`cnnum view`: a live page of an array, a scene or a recording, in a browser."""

import secrets
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
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
    from cnnum.drivers.driver import Driver
    from cnnum.engine import Engine
    from cnnum.frame import Frame
    from cnnum.live.feeds import Feed
    from cnnum.scenes.pipeline import Scene
    from cnnum.scenes.scene_file import SceneSpec

SHOWN = (
    ("contact_map", "bump_contact", "load_normal", "twist"),
    ("contact_map", "load_normal"),
    (),
)
"""Fields that the page draws; as many as a scene's program gives are added to its wants."""

OF_SKIN = (("contact_map", "load_normal", "twist"), *SHOWN[1:])
"""Those of a skin of a hand."""


@click.command("view")
@click.argument("source", shell_complete=completed("scene", files=True))
@click.option(
    "--scene",
    help="Scene to run on a recording; required for raw counts, otherwise 'demo' by default.",
)
@page_options(8765)
@click.option(
    "--record",
    "folder",
    type=click.Path(path_type=Path, exists=True, file_okay=False, writable=True),
    help="Folder of the recordings that the page begins and ends; without it the page makes none.",
)
@scene_options
@trust_option
@json_option
def command(
    source: str,
    scene: str | None,
    host: str,
    port: int,
    token: str,
    folder: Path | None,
    changes: Changes,
    trust: bool,
    as_json: bool,
) -> int:
    """Show SOURCE (a scene, a hand, a driver's name, or a recording) in a browser, until Ctrl-C.

    Only this machine can reach the page; with --host, other machines can, but need a token. A scene
    adds events and outlines to the readings. --set changes keys of the scene or options of the
    driver.
    """
    from cnnum.live.server import Place, is_loopback, run

    if not is_loopback(host) and not token:
        token = secrets.token_urlsafe(12)
    where = Place(host, port, token)
    with busy(COMPILING, as_json=as_json):
        feed = feed_of(source, scene, changes, trust, folder=folder)
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
    source: str,
    scene: str | None,
    changes: dict[str, Any],
    trust: bool,
    *,
    inside: bool = False,
    folder: Path | None = None,
) -> "Feed":
    """Return the feed of a source.

    Parameters
    ----------
    source : str
    scene : str or None
        Scene to run on a recording.
    changes : dict
    trust : bool
    inside : bool
        Whether the program gives the result of every operation.
    folder : Path, optional
        Folder of the recordings that a page begins.
    """
    from cnnum.cli.options import is_hand_file, open_source, usual_scene
    from cnnum.drivers.recording_file import array_of
    from cnnum.drivers.registry import is_driver
    from cnnum.errors import SceneError
    from cnnum.live.feeds import ArrayFeed, HandFeed, RecordingFeed, SceneFeed
    from cnnum.scenes.hand import Hand
    from cnnum.scenes.scene_file import read_hand, read_scene, scene_names

    if is_driver(source):
        options = {key.removeprefix("array."): value for key, value in changes.items()}
        driver = open_source(source, options)
        return ArrayFeed(source, driver, begin=_beginning(folder, source, {"": driver}))
    if source in scene_names() or source.endswith(".toml"):
        if is_hand_file(source):
            skins: dict[str, Scene] = {}
            for name, spec in read_hand(source, changes=changes, trust=trust).items():
                skins[name] = _opened(spec, OF_SKIN, beside=tuple(skins.values()))
            hand = Hand(skins)
            hand.warm_up()
            drivers = {name: opened.driver for name, opened in skins.items()}
            return HandFeed(hand, begin=_beginning(folder, source, drivers))
        opened = _scene(read_scene(source, changes=changes, trust=trust), inside)
        begin = _beginning(folder, source, {"": opened.driver})
        return SceneFeed(opened, inside=inside, begin=begin)
    array = array_of(Path(source))
    if folder is not None:
        raise SceneError(f"'{source}' is a recording already: '--record' is for a live source.")
    chosen = scene or usual_scene(Path(source), array, changes, "demo")
    spec = read_scene(chosen, changes={"array": array} | changes, trust=trust)
    return RecordingFeed(_scene(spec, inside), inside=inside)


def _scene(spec: "SceneSpec", inside: bool) -> "Scene":
    """Return a scene that also gives the fields of the page, as far as its program has it."""
    from cnnum.engine import Engine

    # hundreds of outputs are compiled in seconds by this one, and by OpenCL in minutes
    engine = Engine("numba") if inside and spec.engine is None else None
    why = _read_outs(spec)
    more = dict.fromkeys(((*SHOWN[0], *why), (*SHOWN[1], *why), why, *SHOWN[:-1]))
    opened = _opened(spec, (*more, ()), engine=engine)
    if inside:
        opened.keep_everything()
    return opened


def _opened(
    spec: "SceneSpec",
    choices: "Iterable[tuple[str, ...]]",
    *,
    engine: "Engine | None" = None,
    beside: "tuple[Scene, ...]" = (),
) -> "Scene":
    """Return a scene with the first of these outputs that its program has."""
    from cnnum.errors import SceneError, UnknownNameError
    from cnnum.scenes.pipeline import Scene

    for more in choices:
        every = tuple(dict.fromkeys((*spec.needs, *more)))
        try:
            return Scene.of(replace(spec, needs=every), engine, beside=beside)
        except (SceneError, UnknownNameError):
            if not more:
                raise
    raise AssertionError("the last choice is none")


class Take:
    """A recording that a page has begun: a file for each array.

    Parameters
    ----------
    folder : Path
    source : str
    drivers : mapping of str to Driver
        By the names of skins.
    """

    def __init__(self, folder: Path, source: str, drivers: "Mapping[str, Driver]") -> None:
        from cnnum.cli.commands.record import recorders_of
        from cnnum.safety.files import named_after

        stem = f"{Path(source).stem}-{time.strftime('%Y%m%d-%H%M%S')}"
        names = {skin: f"{stem}-{skin}" if skin else stem for skin in drivers}
        targets = {
            named_after(folder, name, ".mcap"): drivers[skin] for skin, name in names.items()
        }
        made = recorders_of(source, targets, force=False, raw=False)
        self._recorders = dict(zip(drivers, made, strict=True))

    def add(self, name: str, frame: "Frame") -> None:
        """Keep a frame."""
        self._recorders[name].add(frame)

    def finish(self) -> str:
        """Close the files, and return what they hold."""
        outcomes = [recorder.finish() for recorder in self._recorders.values()]
        problems = [outcome.problem for outcome in outcomes if outcome.problem]
        first, *others = [outcome for outcome in outcomes if outcome.frames] or outcomes
        frames = sum(outcome.frames for outcome in outcomes)
        more = f" and {len(others)} more files" if others else ""
        return "; ".join([f"{frames} frames in '{first.file}'{more}.", *problems])


def _beginning(
    folder: Path | None, source: str, drivers: "Mapping[str, Driver]"
) -> "Callable[[], Take] | None":
    """Return what begins a recording; None where no folder is given."""
    return None if folder is None else partial(Take, folder, source, drivers)


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
