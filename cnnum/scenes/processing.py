"""A scene over many recordings: one table of events, and one row for each recording."""

import csv
import glob
import hashlib
import io
import json
import logging
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib import import_module
from os import PathLike
from pathlib import Path, PurePath, PurePosixPath
from threading import RLock
from typing import IO, Any, cast

from cnnum.design.tasks import MANIFEST, Parts, Task, run_tasks
from cnnum.drivers.own_data.sources import READERS
from cnnum.drivers.recording_file import array_of
from cnnum.drivers.registry import open_driver
from cnnum.drivers.uskin_csv import PAD_FILES
from cnnum.engine import Engine
from cnnum.errors import (
    CnnumError,
    CodecError,
    RecordingError,
    RecordingWarning,
    SceneError,
    missing_extra,
    name_error,
)
from cnnum.recordings.addresses import copied, facts_of, files_at, is_address, layout_of, public
from cnnum.recordings.lerobot import INFO, episodes_of, is_lerobot
from cnnum.recordings.message_topics import is_bag
from cnnum.safety.files import (
    beside,
    make_folder,
    put_folder,
    refuse_folder,
    refuse_target,
    sentences,
    write_whole,
    written,
    written_folder,
)
from cnnum.safety.reading import MEGABYTE, open_regular, read_text
from cnnum.scenes.arrangement import program_of
from cnnum.scenes.events import EVENT_RULES, Event
from cnnum.scenes.pipeline import Scene
from cnnum.scenes.scene_file import SceneSpec, read_scene, scene_names
from cnnum.scenes.scene_record import SceneRecord
from cnnum.version import __version__

CHUNK = 16
"""Recordings of a task: what a process that is killed has to do again at most."""

KEPT = 4
"""Kinds of recordings whose scenes a process keeps, as compiling takes longer than a recording."""

ROWS = 1 << 16
"""Rows of a group of a Parquet file."""

NEED_LAYOUT = (".txt", ".tsv", ".dat", ".asc", ".log", ".bin", ".json", ".jsonl", ".ndjson", ".npy")
"""Files of a folder that are recordings only if their layout lies next to them."""

EVENTS: Mapping[str, type] = {
    "recording": str, "time": float, "kind": str, "phase": str, "frame": int, "row": float,
    "column": float, "x_mm": float, "y_mm": float, "direction": float, "strength": float,
    "unit": str, "sense": int, "motion": str, "after_gap": float, "gap_end": float,
    "load_is_bound": bool, "saturated": bool, "rest_held": bool,
}  # fmt: skip
"""Columns of the events, with the fields of `cnnum.Event`; one that an event lacks is empty."""

RECORDINGS: Mapping[str, type] = {
    "recording": str, "frames": int, "ran": int, "bad": int, "dropped": int, "gaps": int,
    "longest_gap": float, "seconds": float, "events": int, "error": str,
}  # fmt: skip
"""Columns of the recordings: frames that came, those on which the program ran, bad and lost ones,
gaps and the longest (s), the time from the first frame to the last (s), events, and why it could
not be processed."""


@dataclass(frozen=True, slots=True)
class Job:
    """A scene that runs over recordings.

    Attributes
    ----------
    scene : str
        Absolute path or name.
    changes : tuple of (key, value)
    trust : bool
    fields : str, optional
        Absolute path of the folder into which a worker puts the fields of each recording.
    """

    scene: str
    changes: tuple[tuple[str, object], ...] = ()
    trust: bool = False
    fields: str | None = None


@dataclass(frozen=True, slots=True)
class Processed:
    """The result of `process`.

    Attributes
    ----------
    events, recordings : Path
        The two tables.
    fields : Path or None
        The fields, if they were wanted.
    count, failed, events_count, frames : int
        Recordings, those that could not be processed, events and frames.
    run_now : int
        Recordings that were not processed before.
    seconds : float
        Wall time, s.
    """

    events: Path
    recordings: Path
    fields: Path | None
    count: int
    failed: int
    events_count: int
    frames: int
    run_now: int
    seconds: float


class Bench:
    """The scenes that a process keeps between recordings, with one engine."""

    def __init__(self, job: Job) -> None:
        self._job, self._kept = job, list[Scene]()
        self._engine: Engine | None = None
        self.turn = RLock()  # threads of a worker take turns

    def scene(self, path: Path) -> Scene:
        """Return the scene over a recording: a kept one if the array is the same."""
        job = self._job
        spec = read_scene(
            job.scene, changes={**dict(job.changes), "array": array_of(path)}, trust=job.trust
        )
        driver = open_driver(spec.driver, spec.driver_options, base=spec.base)
        for kept in self._kept:
            if kept.over(driver):
                return kept
        driver.close()
        if self._engine is None:
            how = {"device": spec.device, "precision": spec.precision, "fallback": spec.fallback}
            self._engine = Engine(spec.engine, **how)
        made = Scene.of(spec, self._engine)
        self._kept = [made, *self._kept[: KEPT - 1]]
        return made

    def line(self, number: int, name: str, place: str) -> str:
        """Return the row and the events of a recording as a line of JSON."""
        row = dict[str, object].fromkeys(RECORDINGS) | {"recording": name, "events": 0}
        events, copy = list[list[object]](), ""
        try:
            with copied(place) if is_address(place) else nullcontext(Path(place)) as path:
                copy = str(path) if is_address(place) else ""
                scene = self.scene(path)
                record = SceneRecord(scene.fields if self._job.fields else ())
                first = last = None
                with _quiet():
                    for moment in scene.results():
                        first = moment.frame.time if first is None else first
                        last = moment.frame.time
                        events += [columns(name, event) for event in moment.events]
                        if self._job.fields:
                            record.add(moment)
            seen = scene.summary()
            if self._job.fields:
                _put_fields(record, Path(self._job.fields) / str(number), name)
            row |= {
                "frames": seen.frames,
                "ran": seen.handed_on,
                "bad": seen.bad_frames,
                "dropped": seen.dropped,
                "gaps": seen.counters.gaps,
                "longest_gap": seen.longest_gap,
                "seconds": 0.0 if last is None or first is None else last - first,
                "events": len(events),
            }
        except CnnumError as error:
            said = str(error).replace(copy, name) if copy else str(error)
            row["error"], events = _legible(said), []
        except Exception as error:  # a fault of ours is that row's, and not the end
            row["error"], events = _legible(f"{type(error).__name__}: {error}"), []
        return json.dumps([row, events])


def _put_fields(record: SceneRecord, target: Path, name: str) -> None:
    """Write the fields of a recording as a Zarr group, in the place of an older try."""
    dataset = record.to_xarray()
    dataset.attrs["recording"] = name
    # a wait for the disk at each of its files would take longer than the recording
    how: dict[str, Any] = {"force": True, "owns": is_zarr, "synced": False}
    with written_folder(target, error=RecordingError, **how) as draft:
        dataset.to_zarr(draft, mode="w", consolidated=False)


def _legible(text: str) -> str:
    """Return a text as UTF-8 can hold it: names of files are any bytes."""
    return text.encode("utf-8", "backslashreplace").decode()


@contextmanager
def _quiet() -> Generator[None]:
    """Drop what is logged of the frames: a sentence that does not name its recording is no help."""
    logger = logging.getLogger("cnnum")
    logger.addFilter(_drop)
    try:
        yield
    finally:
        logger.removeFilter(_drop)


def _drop(_: logging.LogRecord) -> bool:
    return False


@lru_cache(maxsize=1)
def _bench(job: str) -> Bench:
    """Return what this process keeps for a job: its engine takes longer than a recording."""
    held = json.loads(job)
    changes = tuple((key, value) for key, value in held["changes"])
    return Bench(Job(held["scene"], changes, held["trust"], held["fields"]))


def columns(name: str, event: Event) -> list[object]:
    """Return the values of `EVENTS`."""
    row, column = event.where or (None, None)
    x, y = event.place or (None, None)
    values = (
        name, event.time, event.kind, event.phase, event.frame, row, column, x, y, event.direction,
        event.strength, event.unit, event.sense, event.motion, event.after_gap, event.gap_end,
        event.load_is_bound, event.saturated, event.rest_held,
    )  # fmt: skip
    kinds = zip(values, EVENTS.values(), strict=True)
    return [None if value is None else kind(value) for value, kind in kinds]


Part = tuple[Task, tuple[tuple[str, str], ...]]
"""A task, and the names and places of its recordings: absolute paths, or addresses."""


def run_part(job: str, part: Part) -> tuple[Task, str]:
    """Return a task and the lines of its recordings."""
    task, sources = part
    bench = _bench(job)
    with bench.turn, warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordingWarning)  # the row counts what they say
        lines = (bench.line(task[0] + n, *source) for n, source in enumerate(sources))
        return task, "".join(line + "\n" for line in lines)


def sources_of(words: Sequence[str | PathLike[str]]) -> list[Path]:
    """Return the recordings that files, folders and patterns such as "day*/*.mcap" name, sorted.

    In a folder these are, at any depth, the files that `cnnum replay` reads, the folders of uSkin
    trials and bags, and the episodes of LeRobot sets. A file that is named itself is taken as it
    is.

    Raises
    ------
    RecordingError
        If a pattern or a folder has none.
    """
    result = dict[Path, Path]()
    for word in words:
        path = Path(word)
        if path.is_dir():
            files = sorted(_within(path))
        elif not path.exists() and glob.has_magic(str(word)):
            named = glob.glob(str(word), recursive=True)  # noqa: PTH207 - absolute ones too
            fitting = sorted(map(Path, named))
            files = [f for name in fitting for f in (_within(name) if name.is_dir() else [name])]
        else:
            files = [path]
        if not files:
            raise RecordingError(f"There is no recording in '{word}'.")
        for file in files:
            result.setdefault(file.absolute(), file)
    return list(result.values())


def _named(words: Sequence[str | PathLike[str]]) -> dict[str, str]:
    """Return the places of recordings, each once, with the names that tables give them.

    Raises
    ------
    RecordingError
        As `sources_of`, or if an address cannot be read or names a data set.
    """
    result = dict[str, str]()
    for word in words:
        if not is_address(str(word)):
            for file in sources_of([word]):
                result.setdefault(str(file.absolute()), _legible(file.as_posix()))
            continue
        addresses, shown = files_at(str(word)), public(str(word))
        paths = {*addresses.values()}
        if any(PurePosixPath(path).match(INFO) for path in paths):
            raise RecordingError(
                f"'{shown}' holds a LeRobot set, which is a folder: copy it to this machine first."
            )
        fitting = [
            address
            for address, path in addresses.items()
            if len(addresses) == 1
            or (is_recording(PurePosixPath(path), layout_of(path) in paths) and not _is_part(path))
        ]
        if not fitting:
            raise RecordingError(f"There is no recording in '{shown}'.")
        names = {address: _legible(public(address)) for address in fitting}
        result |= {address: result.get(address, name) for address, name in names.items()}
    return result


def is_recording(path: PurePath, has_layout: bool) -> bool:
    """Return whether a file of a folder is a recording, by its name."""
    suffix = path.suffix.lower()
    return (
        suffix in READERS
        and not path.name.endswith(OWN)
        and (has_layout or suffix not in NEED_LAYOUT)
    )


def _is_part(path: str) -> bool:
    return any(name.endswith(PARTS) for name in path.split("/")[:-1])


def _within(folder: Path, above: tuple[Path, ...] = ()) -> Iterator[Path]:
    if (folder / PAD_FILES[0]).exists() or is_bag(folder):
        yield folder
        return
    if is_lerobot(folder):
        try:
            yield from episodes_of(folder)
        except RecordingError:
            yield folder  # its row says why
        return
    above = (*above, folder.resolve())
    for path in sorted(folder.iterdir()):
        if path.is_dir():
            if not path.name.endswith(PARTS) and path.resolve() not in above:  # a link may lead up
                yield from _within(path, above)
        elif is_recording(path, path.with_suffix(".toml").exists()):
            yield path


Rows = Iterator[list[Any]]
Write = Callable[[IO[bytes], Mapping[str, type], Rows], None]
"""Writes the rows of a table with these columns."""

PARTS = ".parts"
OWN = tuple(
    f".{kind}{suffix}" for kind in ("recordings", "events") for suffix in (".parquet", ".csv")
)
"""Endings of tables that `process` wrote itself."""


def process(
    sources: Sequence[str | PathLike[str]] | str | PathLike[str],
    scene: str | PathLike[str],
    out: str | PathLike[str],
    *,
    changes: Mapping[str, object] | None = None,
    fields: str | PathLike[str] | None = None,
    workers: int = 1,
    scheduler: str | None = None,
    trust: bool = False,
    force: bool = False,
    done: Callable[[int, int], None] | None = None,
) -> Processed:
    """Run a scene over recordings, and write a table of events and one of the recordings.

    Results are kept by parts in a folder next to `out`, so that a job that was killed goes on from
    there, and ends in the same bytes with any number of workers. A recording that cannot be
    processed is a row with the reason.

    Parameters
    ----------
    sources : path, or sequence of paths
        Files, folders, patterns such as "day*/*.mcap", and addresses for fsspec of files, folders
        and patterns, such as "s3://bucket/day1/" (extra `remote`).
    scene : str or path
        A scene file, or the name of a packaged scene, whose array each recording replaces.
    out : path
        Of the events: .parquet (extra `lerobot`, for pyarrow) or .csv. The recordings go to
        NAME.recordings.parquet or .csv.
    changes, trust
        As `cnnum.load_scene`.
    fields : path, optional
        Zarr folder for the fields that the scene wants (extra `zarr`), with a group for each
        recording, named by the number of its row from 0.
    workers : int
        Processes of this machine. A script that uses more than one needs the usual
        ``if __name__ == "__main__":``.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers see the same files.
    force : bool
        Whether tables and fields that are there are replaced.
    done : callable, optional
        Called with (recordings done, all recordings) after each part.

    Raises
    ------
    MissingExtraError
        If pyarrow, Dask, fsspec or Zarr is asked for and not installed.
    CnnumError
        If there is no recording, the scene has a fault, a table is there already, or the parts
        next to it are those of another job.
    """
    begin, target = time.perf_counter(), Path(out)
    write = _writer(target)
    tables = target, target.with_name(f"{target.stem}.recordings{target.suffix}")
    folder = None if fields is None else Path(fields)
    resumes = (beside(target, PARTS) / MANIFEST).exists()
    _refuse_outputs(tables, folder, force=force or resumes)
    given = [sources] if isinstance(sources, str | PathLike) else list(sources)
    named = _named(given)
    for table in tables:
        named.pop(str(table.absolute()), None)
    files, where = list(named), str(scene)
    where = where if where in scene_names() else str(Path(scene).absolute())
    spec = read_scene(where, changes=changes, trust=trust)  # a fault of the scene is no recording's
    facts = {"scene": where, "changes": list((changes or {}).items()), "trust": trust}
    if folder is not None:
        _refuse_no_zarr(spec)
        facts["fields"] = str(folder.absolute())
    key = _key(json.dumps(facts), where, spec, files)
    groups = None if folder is None else beside(folder, f".{key[:12]}{PARTS}")
    job = json.dumps(facts | {"fields": None if groups is None else str(groups.absolute())})
    parts = Parts(beside(target, PARTS), key, ".jsonl", RecordingError, "job")
    with parts.held():
        chunk = parts.chunk()
        if chunk is None:
            chunk = CHUNK
            parts.begin(chunk)
        tasks = [(n, min(n + chunk, len(files))) for n in range(0, len(files), chunk)]
        missing = list(parts.missing(tasks))
        if resumes and missing:
            _refuse_outputs(tables, folder, force=force)
        elif resumes:  # it was killed while it put its own results in their places
            force = True
        if groups is not None and missing:
            with sentences(groups, RecordingError):
                make_folder(groups)
        items = [
            (task, tuple((named[file], file) for file in files[slice(*task)])) for task in missing
        ]
        now = sum(last - first for first, last in missing)
        count = len(files) - now
        work, name = partial(run_part, job), f"process-{parts.key}"
        for (first, last), text in run_tasks(
            work, items, scheduler=scheduler, workers=workers, name=name
        ):
            write_whole(parts.file((first, last)), text, error=RecordingError, force=True)
            count += last - first
            if done is not None:
                done(count, len(files))
        totals = _write_tables(tables, write, parts, tasks, force=force)
        if folder is not None and groups is not None and groups.is_dir():
            with sentences(groups, RecordingError):
                import_module("zarr").open_group(groups, mode="a")
            put_folder(groups, folder, error=RecordingError, force=force, owns=is_zarr)
        parts.remove()
    spent = time.perf_counter() - begin
    counts = len(files), totals.failed, totals.found, totals.frames, now
    return Processed(*tables, folder, *counts, spent)


def _write_tables(
    tables: tuple[Path, Path], write: Write, parts: Parts, tasks: Sequence[Task], *, force: bool
) -> "_Totals":
    """Write the tables of events and recordings from all parts; return what they hold."""
    totals = _Totals()
    for table, kinds, pick in (
        (tables[1], RECORDINGS, totals.rows),
        (tables[0], EVENTS, totals.events),
    ):
        with written(table, error=RecordingError, force=force) as file:
            write(file, kinds, (values for part in _lines(parts, tasks) for values in pick(part)))
    return totals


def _refuse_outputs(tables: Sequence[Path], fields: Path | None, *, force: bool) -> None:
    """Raise if something is in the place of a result."""
    for table in tables:
        refuse_target(table, error=RecordingError, force=force)
    if fields is not None:
        refuse_folder(fields, error=RecordingError, force=force, owns=is_zarr)


def _refuse_no_zarr(spec: SceneSpec) -> None:
    """Raise if fields cannot be written, before the work."""
    for module, library in (("zarr", "zarr"), ("xarray", "xarray")):
        try:
            import_module(module)
        except ImportError:
            raise missing_extra("a folder of fields", library, "zarr") from None
    events = {*EVENT_RULES, *spec.own}
    if spec.needs and {*spec.needs} <= events:
        raise SceneError(
            "The scene requests only events and no field, so '--fields' would hold nothing: add a "
            "field to its 'needs' ('cnnum plan' lists them)."
        )


def is_zarr(folder: Path) -> bool:
    """Return whether a folder holds Zarr groups and arrays, and no other file."""
    names = [path.relative_to(folder) for path in folder.rglob("*") if not path.is_dir()]
    return all(name.name == "zarr.json" or "c" in name.parts[:-1] for name in names) and (
        not names or (folder / "zarr.json").is_file()
    )


@dataclass(slots=True)
class _Totals:
    """What is counted while the tables are written."""

    failed: int = 0
    found: int = 0
    frames: int = 0

    def rows(self, part: tuple[dict[str, Any], list[list[Any]]]) -> Iterator[list[Any]]:
        row = part[0]
        self.failed += row["error"] is not None
        self.found += row["events"]
        self.frames += row["frames"] or 0
        yield [row[name] for name in RECORDINGS]

    def events(self, part: tuple[dict[str, Any], list[list[Any]]]) -> Iterator[list[Any]]:
        yield from part[1]


def _lines(parts: Parts, tasks: Sequence[Task]) -> Iterator[tuple[dict[str, Any], list[list[Any]]]]:
    """Yield the row and the events of each recording, in order."""
    for task in tasks:
        place = parts.file(task)
        try:
            with open_regular(place) as file:
                lines = [json.loads(line) for line in file]
            if len(lines) != task[1] - task[0]:
                raise ValueError("a line is missing")
        except (OSError, ValueError):
            raise CodecError(
                f"'{place}' is damaged: remove it, and the same command recreates it."
            ) from None
        yield from cast("list[tuple[dict[str, Any], list[list[Any]]]]", lines)


def _key(job: str, scene: str, spec: SceneSpec, files: Sequence[str]) -> str:
    """Return what tells a job from others: the scene, and names, sizes and times of all files.

    Among these are the layouts of recordings, and the scene's own program and calibration.
    """
    digest = hashlib.sha256(f"{__version__}\n{job}\n".encode())
    if Path(scene).is_file():
        digest.update(read_text(Path(scene), most=MEGABYTE).encode())
    code = Path(program_of(spec).function.__code__.co_filename)
    paths = [Path(file) for file in files if not is_address(file)]
    layouts = [path.with_suffix(".toml") for path in paths]
    for path in (*paths, *layouts, code, spec.base / spec.calibration):
        inner = sorted(path.iterdir()) if path.is_dir() else [path]
        facts = [
            (p.name, s.st_size, s.st_mtime_ns) for p in inner if p.exists() for s in [p.stat()]
        ]
        digest.update(f"{_legible(path.as_posix())} {facts}\n".encode())
    for address in filter(is_address, files):
        digest.update(f"{_legible(address)} {facts_of(address)}\n".encode())
    return digest.hexdigest()[:32]


def _writer(target: Path) -> Write:
    """Return the function that writes a table of this suffix."""
    suffix = target.suffix.lower()
    if suffix == ".csv":
        return _write_csv
    if suffix != ".parquet":
        raise name_error("kind of table", target.suffix or target.name, (".parquet", ".csv"))
    try:
        arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        raise missing_extra(
            "Parquet files", "pyarrow", "lerobot", "a name that ends in .csv needs nothing"
        ) from None
    return partial(_write_parquet, arrow, parquet)


def _write_csv(file: IO[bytes], kinds: Mapping[str, type], rows: Rows) -> None:
    text = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
    try:
        table = csv.writer(text)
        table.writerow(kinds)
        table.writerows(
            [int(value) if isinstance(value, bool) else value for value in row] for row in rows
        )
    finally:
        text.detach()


def _write_parquet(
    arrow: Any, parquet: Any, file: IO[bytes], kinds: Mapping[str, type], rows: Rows
) -> None:
    types = {str: arrow.string(), float: arrow.float64(), int: arrow.int64(), bool: arrow.bool_()}
    schema = arrow.schema([(name, types[kind]) for name, kind in kinds.items()])
    group = list[list[Any]]()

    def put() -> None:
        arrays = [
            arrow.array(list(column), kind.type)
            for column, kind in zip(zip(*group, strict=True), schema, strict=True)
        ]
        table.write_table(arrow.Table.from_arrays(arrays, schema=schema))
        group.clear()

    with parquet.ParquetWriter(file, schema) as table:
        for row in rows:
            group.append(row)
            if len(group) == ROWS:
                put()
        if group:
            put()
