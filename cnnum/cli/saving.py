"""The option `--save`: fields of a scene into a file, next to its events."""

from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cnnum.cli.options import target_option

if TYPE_CHECKING:
    from cnnum.scenes.pipeline import FrameResult, Scene

save_option = target_option(
    "--save",
    "FILE.npz|csv|nc|txt",
    "Write the fields that the scene wants, a row a frame; as .txt spikes, a line each.",
)


rerun_option = click.option(
    "--rerun",
    metavar="FILE.rrd|ADDRESS",
    help="Send pictures and events to Rerun: to a file or a running viewer.",
)


@contextmanager
def to_rerun(
    scene: "Scene", target: str | None, *, force: bool
) -> Generator[Callable[["FrameResult"], object]]:
    """Yield the function that sends a moment to Rerun; one that does nothing without a target."""
    if target is None:
        yield lambda _: None
        return
    from cnnum.live.rerun_sink import RerunSink

    with RerunSink(scene, target, force=force) as sink:
        yield sink.add


class FieldSaver:
    """Keeps the fields of a scene while it is followed, and writes them at its end.

    Parameters
    ----------
    path : Path or None
        Nothing is kept without one.
    scene : Scene
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    SceneError
        If the scene wants no field.
    """

    def __init__(self, path: Path | None, scene: "Scene", *, force: bool = False) -> None:
        from cnnum.scenes.scene_record import (
            SceneRecord,
            refuse_no_fields,
            refuse_no_spikes,
        )

        self._path, self._force = path, force
        self._record = SceneRecord(scene.fields)
        if path is not None:
            refuse_no_fields(scene.fields, scene.offered)
            refuse_no_spikes(path, scene.fields)

    def add(self, moment: "FrameResult") -> None:
        """Keep a moment."""
        if self._path is not None:
            self._record.add(moment)

    def write(self) -> Mapping[str, str]:
        """Write the file, and return its place for the summary."""
        if self._path is None:
            return {}
        self._record.save(self._path, force=self._force)
        return {"saved": str(self._path)}


def refuse_unknown(save: Path | None) -> None:
    """Refuse a file of fields of an unknown kind, before the work.

    Raises
    ------
    UnknownNameError
    """
    if save is not None:
        from cnnum.scenes.scene_record import suffix_of

        suffix_of(save)


def watching(*watchers: Callable[["FrameResult"], object]) -> Callable[["FrameResult"], None]:
    """Return the function that gives every moment to all watchers."""

    def watch(moment: "FrameResult") -> None:
        for each in watchers:
            each(moment)

    return watch
