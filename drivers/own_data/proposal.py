"""The layout of a file of others, as far as the file itself shows it."""

import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.codecs.wire import Asked, protocol_names, wire
from cnnum.drivers.npz_file import array_shapes
from cnnum.drivers.own_data.proposed_shape import (
    Proposal,
    family_of,
    frames_axis,
    name_columns,
    parts_of_frame,
    take_axes,
    take_order,
    take_parts,
)
from cnnum.drivers.own_data.proposed_table import first_lines, of_text
from cnnum.drivers.own_data.proposed_times import (
    COUNTER,
    TIME,
    ask_rate,
    take_clock,
    take_unit,
    unit_of_times,
)
from cnnum.drivers.own_data.sources import HDF5, MAT
from cnnum.drivers.uskin_csv import refuse_several
from cnnum.errors import CnnumError, CodecError, RecordingError, unreadable
from cnnum.recordings.hdf5_file import PARQUET, list_hdf5, read_hdf5
from cnnum.recordings.message_topics import (
    BAGS,
    LINES,
    STAMPS,
    is_bag,
    messages,
    names_of,
    numeric_fields,
    part_of,
)
from cnnum.safety.reading import open_regular

LOOKED_AT, SOME, FEW, LOOKED_BYTES = 400, 5, 10, 1 << 20
"""Messages that are looked at, those of a topic whose fields are, frames among which numbers rise
by chance, and bytes that are tried with a protocol."""

CONTAINERS = {
    b"\x1f\x8b": "is compressed: unpack it, as by 'gunzip'",
    b"BZh": "is compressed: unpack it, as by 'bunzip2'",
    b"\xfd7zXZ": "is compressed: unpack it, as by 'unxz'",
    b"(\xb5/\xfd": "is compressed: unpack it, as by 'unzstd'",
    b"PK": "is a ZIP archive, as Excel writes, too: unpack it, or save the sheet as CSV",
    b"\xd0\xcf\x11\xe0": "is a workbook of Excel: save the sheet as CSV",
    b"MATLAB 5": "is a file of MATLAB before 7.3: save it there with '-v7.3'",
    b"ARROW1": "is a Feather file: write Parquet, as by df.to_parquet",
    b"SQLite": "is a database of SQLite: write its table as CSV",
    b"\x80": "seems to be a pickle of Python, which may run code: write the arrays by numpy.savez",
}
"""What files of other kinds begin with, and what is to be done with them."""

PAD = re.compile(r"shape = \[(\d+), (\d+)\]")
"""The shape that a decoder asks for where it finds pads of several."""

STAMPED = re.compile(r"timestamp|duration")
"""Types of columns of Parquet that are times; they are read in ns."""

LIKELY = re.compile(r"tact|taxel|touch|skin|press|force|sensor|xela|values|data|grid", re.I)


def propose(path: Path, topic: str = "", clock: str = "") -> Proposal:
    """Return the layout that a file seems to have.

    Parameters
    ----------
    path : Path
    topic : str
        Topic of an MCAP file or a bag; that with the most numbers unless given.
    clock : str
        Column or array of the times; by its name unless given.

    Raises
    ------
    RecordingError, CodecError
        If it cannot be read, or shows no frames.
    """
    suffix = path.suffix.lower()
    if suffix in LINES and (proposal := _sent(path, ("xela",))) is not None:
        return proposal
    if is_bag(path) or suffix in (".mcap", *LINES, *BAGS):
        return _of_messages(path, topic, clock)
    if path.is_dir():
        refuse_several(path)
        raise RecordingError(f"'{path}' is a trial, which needs no layout.")
    if suffix in (".npy", ".npz"):
        return _of_arrays(path, array_shapes(path), clock)
    with open_regular(path) as file:
        begin = file.read(8)
    for sign, said in CONTAINERS.items():
        if begin.startswith(sign) and suffix not in (".bin", ".raw", ".log"):
            raise CodecError(f"'{path}' {said}.")
    if suffix in (*HDF5, PARQUET):
        return _of_arrays(path, list_hdf5(path)[0], clock)
    text = first_lines(path)
    if text is None or suffix in (".bin", ".raw"):
        proposal = _sent(path, protocol_names())
        if proposal is None:
            raise CodecError(
                f"'{path}' is neither a table in a text file nor the output of an array with a "
                "known protocol."
            )
        return proposal
    if suffix == ".log" and (proposal := _sent(path, protocol_names())) is not None:
        return proposal
    return of_text(path, text, clock)


# arrays: NumPy, HDF5, Parquet


def _of_arrays(
    path: Path, shapes: Mapping[str, tuple[tuple[int, ...], str]], asked: str
) -> Proposal:
    proposal = Proposal()
    stamped = {name for name, (_, kind) in shapes.items() if STAMPED.match(kind)}
    numeric = {
        name: shape
        for name, (shape, kind) in shapes.items()
        if name in stamped
        or (
            re.search(r"int|float|double|halffloat|uint|bool|list|[<>|=]?[fiub]\d", kind)
            and "string" not in kind
        )
    }
    clocks = {n: s for n, s in numeric.items() if max(s, default=0) == math.prod(s) and s}
    frames = {n: s for n, s in numeric.items() if len(s) > 1 and n not in clocks}
    if not frames:
        lines = {name: shape for name, shape in clocks.items() if len(shape) == 1}
        usual = Counter(lines.values()).most_common(1)
        columns = [name for name, shape in lines.items() if shape == usual[0][0]]
        if sum(not TIME.search(name.rpartition("/")[2]) for name in columns) > 1:
            return _of_columns(path, columns, stamped, asked)
        raise CodecError(
            f"'{path}' has no array of frames; its arrays are "
            f"{', '.join(f'{n} {s}' for n, (s, _) in list(shapes.items())[:12]) or 'none'}."
        )
    lengths = Counter(math.prod(shape) for shape in clocks.values())

    def rank(name: str) -> tuple[bool, bool, float]:
        shape = frames[name]
        timed = any(size in lengths for size in shape)
        likely = LIKELY.search(name) is not None
        return likely and "image" not in name, timed, math.prod(shape)

    name = max(frames, key=rank)
    parts = parts_of_frame({n: s[1:] for n, s in frames.items() if s[0] == frames[name][0]})
    parts = [] if path.suffix.lower() == PARQUET else parts
    if parts and len(parts) * math.prod(frames[parts[0]]) > math.prod(frames[name]):
        return _of_parts(path, proposal, parts, frames, shapes, clocks, stamped, asked)
    others = [other for other in frames if other != name and LIKELY.search(other)]
    if others:
        proposal.undecided.append(
            f"values: '{name}' is taken of {', '.join(map(repr, (name, *others[:6])))}"
        )
    turned = path.suffix.lower() == MAT
    shape = frames[name][::-1] if turned else frames[name]
    at = frames_axis(proposal, shape, lengths, lambda: _array_of(path, name, shape))
    count = shape[at]
    axes = take_axes(proposal, (*shape[:at], *shape[at + 1 :]))
    take_order(proposal, axes, sum(size > 1 for size in shape[:at]), turned)
    if axes == ["rows cols channels"] and count > FEW:
        held: Floats = np.moveaxis(_array_of(path, name, shape), at, 0).reshape(count, -1)
        for place in np.flatnonzero((np.diff(held, axis=0) > 0.0).all(axis=0)).tolist():
            raise CodecError(
                f"'{path}': number {place} of a frame{f' in {name!r}' * bool(name)} rises from "
                "frame to frame, as a time does: keep it in an array of its own."
            )
    if path.suffix.lower() != ".npy":
        proposal.table = {"values": name, **proposal.table}
    proposal.seen.append(f"{count} frames in '{name}' {shape}" if name else f"{count} frames")
    _array_times(path, proposal, count, clocks, stamped, asked)
    take_unit(proposal, (name,), "int" in shapes[name][1] or "u" in shapes[name][1][:2])
    return proposal


def _of_parts(
    path: Path,
    proposal: Proposal,
    parts: list[str],
    frames: Mapping[str, tuple[int, ...]],
    shapes: Mapping[str, tuple[tuple[int, ...], str]],
    clocks: Mapping[str, tuple[int, ...]],
    stamped: Collection[str],
    asked: str,
) -> Proposal:
    take_parts(proposal, parts, frames[parts[0]][1:])
    proposal.seen.append(f"{frames[parts[0]][0]} frames")
    _array_times(path, proposal, frames[parts[0]][0], clocks, stamped, asked)
    take_unit(proposal, parts, "int" in shapes[parts[0]][1])
    return proposal


def _array_times(
    path: Path,
    proposal: Proposal,
    count: int,
    clocks: Mapping[str, tuple[int, ...]],
    stamped: Collection[str],
    asked: str,
) -> None:
    times = [n for n, s in clocks.items() if math.prod(s) == count]
    times.sort(key=lambda n: (n not in stamped, not TIME.search(n.rpartition("/")[2]), len(n)))
    known = [n for n in times if n in stamped or TIME.search(n.rpartition("/")[2])]
    others = [n for n in times if not COUNTER.search(n.rpartition("/")[2])]
    if not asked or asked in clocks:
        take_clock(proposal, asked, known[:1], others[:8], lambda n: _one_array(path, n), stamped)


def _array_of(path: Path, name: str, shape: Sequence[int]) -> Floats:
    flat = _one_array(path, name)
    return flat.reshape(shape[::-1]).T if path.suffix.lower() == MAT else flat.reshape(shape)


def _one_array(path: Path, name: str) -> Floats:
    if path.suffix.lower() in (*HDF5, PARQUET):
        return np.asarray(read_hdf5(path, [name])[1][name], np.float64).reshape(-1)
    if not name:
        from cnnum.drivers.own_data.layout import DataLayout
        from cnnum.drivers.own_data.sources import VALUES, npy_array

        held = npy_array(path, DataLayout((1, 1), rate=1.0))
        return np.asarray(held[VALUES], np.float64).reshape(-1)
    from cnnum.drivers.npz_file import read_arrays

    return np.asarray(read_arrays(path, {name})[name], np.float64).reshape(-1)


def _of_columns(path: Path, columns: list[str], stamped: Collection[str], asked: str) -> Proposal:
    """Return the layout of a file with one array per number, as of a table in text."""
    proposal = Proposal()
    known = [name for name in columns if name in stamped or TIME.search(name)]
    known.sort(key=lambda name: name not in stamped)
    others = [name for name in columns[:1] if not COUNTER.search(name)]
    asked = asked if asked in columns else ""
    clock = take_clock(proposal, asked, known, others, lambda name: _one_array(path, name), stamped)
    rest = [name for name in columns if name != clock and not COUNTER.search(name)]
    rest = [name for name in rest if name not in known]
    family = family_of(rest)
    name_columns(proposal, family, rest, listed=True)
    take_unit(proposal, rest, False)
    return proposal


# messages


def _of_messages(path: Path, topic: str, asked: str) -> Proposal:
    proposal = Proposal()
    seen: dict[str, list[list[tuple[str, tuple[int, ...]]]]] = {}
    faults: dict[str, CnnumError] = {}
    count = 0
    with closing(messages(path, topic)) as every:
        for message in islice(every, LOOKED_AT):
            count += 1
            some = seen.setdefault(message.topic, [])
            if len(some) < SOME:
                try:
                    content = message.content()
                    some.append(list(numeric_fields(content)) or _scalars(content))
                except CnnumError as error:
                    some.append([])
                    faults.setdefault(message.topic, error)
    # of the first messages the one with the most fields: another may lack some
    found = {name: max(some, key=len) for name, some in seen.items()}
    for name, fields in found.items():
        if name in faults and not fields:
            if path.suffix.lower() in LINES:
                raise faults[name]
            proposal.undecided.append(f"topic '{name}': {faults[name]}")
    ranked = [
        (LIKELY.search(f"{name}.{part}") is not None, math.prod(shape), -len(part), name, part)
        for name, parts in found.items()
        for part, shape in parts
        if "covariance" not in part
    ]
    if not ranked:
        there = ", ".join(map(repr, list(found)[:12])) or "none"
        raise CodecError(f"'{path}' has no message with several numbers; its topics are {there}.")
    *_, name, part = max(ranked)
    shape = dict(found[name])[part]
    parts = parts_of_frame(dict(found[name]))
    if len({one[3] for one in ranked}) > 1:
        proposal.undecided.append(
            f"topic: '{name}' is taken of {', '.join(sorted({repr(one[3]) for one in ranked}))}"
        )
    proposal.table = {"topic": name} if name else {}
    if path.suffix.lower() in LINES and (count == 1 or len(shape) == 4):
        raise CodecError(
            f"'{path}' holds all frames in one message, '{part}' of the shape {shape}: make it a "
            "message a frame, or an archive, as by numpy.savez."
        )
    if parts and len(parts) * math.prod(dict(found[name])[parts[0]]) > math.prod(shape):
        take_parts(proposal, parts, dict(found[name])[parts[0]])
    elif shape:
        proposal.table["values"] = part
        take_axes(proposal, shape)
        proposal.seen.append(f"'{part}' {shape} in each message")
    else:
        family = family_of([one for one, _ in found[name] if not COUNTER.search(one)])
        name_columns(proposal, family, [one for one, _ in found[name]], listed=True)
    if not name:  # lines of JSON have no time of their own
        _line_times(path, proposal, asked)
    take_unit(proposal, (part,), False)
    return proposal


def _scalars(content: Any) -> list[tuple[str, tuple[int, ...]]]:
    """Return the numbers of a message that has no list, but those that are named as times."""
    numbers = (name for name in names_of(content) if type(part_of(content, name)) in (int, float))
    result: list[tuple[str, tuple[int, ...]]] = [(n, ()) for n in numbers if not TIME.search(n)]
    return result if len(result) > 1 else []


def _line_times(path: Path, proposal: Proposal, asked: str) -> None:
    with closing(messages(path, "")) as every:
        some = list[Any]()
        for message in islice(every, LOOKED_AT):
            with suppress(CodecError):  # its reader counts it
                some.append(message.content())
    stamps = [set(pair) for pair in STAMPS]
    usual: Any = max(some, key=lambda content: len(names_of(content)), default=None)
    for name in _paths(usual):
        if asked in ("", name) and set(names_of(part_of(usual, name))) in stamps:
            proposal.table["time"] = name
            return
    for name in names_of(usual):
        held = [part_of(one, name) for one in some if name in names_of(one)]
        wanted = name == asked if asked else TIME.search(name)
        if wanted and all(isinstance(one, int | float) for one in held):
            unit = unit_of_times(name, np.array(held, np.float64), asked=bool(asked))
            if unit:
                proposal.table |= {"time": name, "time_unit": unit}
                return
    ask_rate(proposal)


def _paths(content: object, depth: int = 3) -> Iterator[str]:
    """Yield the paths of fields that have fields of their own."""
    for name in names_of(content) if depth else ():
        part = part_of(content, name)
        if names_of(part):
            yield name
            yield from (f"{name}.{deeper}" for deeper in _paths(part, depth - 1))


# bytes as an array sent them


def _sent(path: Path, names: Iterable[str]) -> Proposal | None:
    """Return the layout of a file that holds what an array sent, or None if no protocol fits."""
    try:
        with open_regular(path) as file:
            data = file.read(LOOKED_BYTES)
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None
    best: tuple[float, str, Any, bool] = (0.0, "", None, False)
    trouble = ""
    for name in names:
        try:
            known = wire(name, Asked())
            decoder = known.decoder()
            scans = [*decoder.feed(data), *decoder.flush()]
            said = str(getattr(decoder, "trouble", ""))
            if not scans and (one := PAD.search(said)) is not None:
                trouble = said
                decoder = wire(name, Asked(shape=(int(one[1]), int(one[2])))).decoder()
                scans = [*decoder.feed(data), *decoder.flush()]
        except CnnumError:
            continue
        whole = 1.0 - decoder.discarded / max(1, len(data))
        score = whole * decoder.good / (decoder.good + decoder.bad + 1)
        if len(scans) > 4 and score > best[0]:
            best = score, name, scans[0], scans[0].time_us is not None
    score, name, scan, timed = best
    if scan is None or score < 0.8:
        return None
    proposal = Proposal()
    rows, cols, _ = scan.values.shape
    proposal.table = {"protocol": name, "shape": (rows, cols), "channels": _short(scan.channels)}
    proposal.table["unit"] = scan.unit
    proposal.seen.append(f"packets of the protocol '{name}'")
    if trouble:
        proposal.undecided.append(f"shape: {trouble}")
    if not timed:
        ask_rate(proposal)
    return proposal


def _short(channels: Sequence[str]) -> tuple[str, ...]:
    short = {"shear_x": "x", "shear_y": "y", "normal": "z"}
    return tuple(short.get(name, name) for name in channels)
