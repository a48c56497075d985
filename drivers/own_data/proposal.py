"""The layout of a file of others, as far as the file itself shows it."""

import json
import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from io import TextIOWrapper
from itertools import islice, product
from pathlib import Path
from typing import Any, cast

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.codecs.wire import Asked, protocol_names, wire
from cnnum.drivers.npz_file import array_shapes
from cnnum.drivers.own_data.hdf5_file import PARQUET, list_hdf5, read_hdf5
from cnnum.drivers.own_data.sources import HDF5
from cnnum.drivers.text_table import (
    MISSING,
    SEPARATORS,
    TextForm,
    by_format,
    fields_of,
    nanoseconds,
)
from cnnum.drivers.uskin_csv import refuse_several
from cnnum.errors import CnnumError, CodecError, RecordingError, unreadable
from cnnum.recordings.messages import (
    BAGS,
    LINES,
    STAMPS,
    is_bag,
    messages,
    names_of,
    numeric_fields,
    part_of,
)
from cnnum.recordings.times import rate_of
from cnnum.safety.reading import open_regular

LOOKED_AT = 400
"""Lines of a text file that are looked at."""

LOOKED_BYTES, LONGEST = 1 << 20, 1 << 22
"""Bytes that are tried with a protocol, and letters of a line."""

WORDS: Mapping[str, tuple[str, ...]] = {
    "x": (
        "x",
        "fx",
        "bx",
        "tx",
        "sx",
        "gx",
        "shearx",
        "forcex",
        "tangx",
        "tangentialx",
        "lateralx",
    ),
    "y": (
        "y",
        "fy",
        "by",
        "ty",
        "sy",
        "gy",
        "sheary",
        "forcey",
        "tangy",
        "tangentialy",
        "lateraly",
    ),
    "z": ("z", "fz", "bz", "tz", "sz", "gz", "normal", "pressure", "forcez", "fn"),
}
"""Words for the three axes of a taxel in the names of columns."""

TIME = re.compile(
    r"(?:^|[^a-z])(?:ts|times?|stamps?|timestamps?|clock|seconds|secs?|elapsed|epoch"
    r"|ticks?|milli(?:s|seconds?)|micro(?:s|seconds?)|zeit|zeitstempel|temps|tiempo)(?:$|[^a-z])"
    r"|^t(?:$|[ _\[(.])",
    re.IGNORECASE,
)
"""Names of times. A "t" with a number is a taxel."""

UNIT_WORDS = {
    "ns": "ns|nanos|nanoseconds?",
    "us": "us|µs|usecs?|micros|microseconds?",
    "ms": "ms|msecs?|millis|milliseconds?",
    "s": "s|secs?|seconds?",
}
"""Words for units in the names of times."""

COUNTER = re.compile(r"^(?:|index|frame|frame.?(?:no|nr|id|index|number)|seq|sequence|n|#)$", re.I)
BRACKETS = re.compile(r"\s*[\[(][^\])]*[\])]\s*")
UNITS = {"N": "N", "n": "N", "kpa": "kPa", "pa": "Pa", "v": "V", "mv": "mV", "psi": "psi"}
PAD = re.compile(r"shape = \[(\d+), (\d+)\]")
"""The shape that a decoder asks for where it finds pads of several."""

MOSTLY = 0.9
"""Part of a column's fields that are numbers, from which another word in it is a fault."""

MONITOR = re.compile(r"\s*\d+:\d+:\d+[.,]?\d* -> ")
"""What Arduino's serial monitor writes before a line."""

LIKELY = re.compile(r"tact|taxel|touch|skin|press|force|sensor|xela|values|data|grid", re.I)
TIME_UNITS = ("s", "ms", "us", "ns")
SCALE = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

SLOWEST, QUICKEST = 2.0, 5000.0
"""Hz of an array, for the unit of times that do not say it."""

CLEARLY = 4
"""Times the other axes from which one is clearly the longest."""

CROSS = 5
"""Magnetometers of an AnySkin."""

KNOWN_SHAPES: Mapping[int, tuple[int, int]] = {24: (4, 6), 384: (12, 32), 5: (1, 5)}
"""Rows and columns by the number of taxels where these are no square: XELA's uSPa46, FlexiTac's
12×32, AnySkin's five magnetometers."""


@dataclass(slots=True)
class Proposal:
    """A layout, and what is not known of it.

    Attributes
    ----------
    table : dict of str to object
        The keys of the layout.
    undecided : list of str
        Sentences on what the file does not show, and what is taken.
    seen : list of str
        Sentences on what it shows.
    """

    table: dict[str, object] = field(default_factory=dict[str, object])
    undecided: list[str] = field(default_factory=list[str])
    seen: list[str] = field(default_factory=list[str])

    def text(self) -> str:
        """Return the layout as TOML."""
        lines = [f"# {line}" for line in self.undecided]
        lines += [f"{key} = {toml_text(value)}" for key, value in self.table.items()]
        if "rate" not in self.table and not {"time", "topic", "protocol"} & set(self.table):
            lines.append("# rate = (frames a second: the file does not say it)")
        return "\n".join(lines) + "\n"


def toml_text(value: object) -> str:
    """Return a value as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, tuple | list):
        items = cast("Iterable[object]", value)
        return "[" + ", ".join(toml_text(item) for item in items) + "]"
    return repr(value)


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
    if suffix in (*HDF5, PARQUET):
        return _of_arrays(path, list_hdf5(path)[0], clock)
    text = _lines(path)
    if text is None or suffix in (".bin", ".raw"):
        proposal = _sent(path, protocol_names())
        if proposal is None:
            raise CodecError(
                f"'{path}' is neither a table in a text file, nor what an array of a known "
                "protocol sent."
            )
        return proposal
    if suffix == ".log" and (proposal := _sent(path, protocol_names())) is not None:
        return proposal
    return _of_text(path, text, clock)


# frames and their shape


def _shape(proposal: Proposal, taxels: int, sure: bool = False) -> tuple[int, int]:
    """Return rows and columns of taxels that only their number is known of."""
    root = math.isqrt(taxels)
    if root * root == taxels:
        shape = root, root
    elif taxels in KNOWN_SHAPES:
        shape = KNOWN_SHAPES[taxels]
    else:
        rows = max(n for n in range(1, root + 1) if taxels % n == 0)
        shape = rows, taxels // rows
    if taxels == CROSS:
        proposal.undecided.append(
            "positions: five taxels are taken as a line; AnySkin's lie on a cross, which is "
            "positions = [[0, 0], [-7, 0], [7, 0], [0, -7], [0, 7]]"
        )
    if taxels > 1 and not sure:
        proposal.undecided.append(
            f"shape: {taxels} taxels are taken as {shape[0]} rows of {shape[1]}, from left to right"
        )
    return shape


def _channels(proposal: Proposal, numbers: int) -> int:
    """Return how many numbers a taxel has."""
    root = math.isqrt(numbers)
    third = numbers // 3
    if (numbers % 3 == 0 and (math.isqrt(third) ** 2 == third or third in KNOWN_SHAPES)) or (
        numbers % 3 == 0 and root * root != numbers and numbers not in KNOWN_SHAPES
    ):
        count = 3
    else:
        count = 1
    proposal.undecided.append(
        f"channels: {numbers} numbers a frame are taken as {numbers // count} taxels of {count}"
    )
    return count


def _said_channels(proposal: Proposal, count: int) -> None:
    if count == 3:
        proposal.table["channels"] = ("x", "y", "z")
        proposal.undecided.append(
            "channels: the three numbers of a taxel are taken as x (shear to the right), y (shear "
            "downwards) and z (normal): 'cnnum check' looks whether a press agrees"
        )
    elif count == 1:
        proposal.table["channels"] = ("z",)
    else:
        proposal.table["channels"] = tuple(f"c{n}" for n in range(count))
        proposal.undecided.append(f"channels: {count} numbers a taxel, whose names are not known")


def _of_axes(proposal: Proposal, shape: Sequence[int]) -> list[str]:
    """Set shape and channels by the axes of a frame, and return what each long axis is."""
    axes = [size for size in shape if size > 1] or [1]
    few = (2, 3, 4, 6)
    if len(axes) == 3 and (axes[0] in few or axes[2] in few):
        last = axes[2] == 3 or (axes[2] in few and axes[0] != 3)
        count = axes[2] if last else axes[0]
        proposal.table["shape"] = tuple(axes[:2] if last else axes[1:])
        names = ["rows", "cols", "channels"] if last else ["channels", "rows", "cols"]
        if axes[0] in few and axes[2] in few and axes[2] != 3:
            proposal.undecided.append(
                f"order: {axes[0]} channels of {axes[1]}×{axes[2]} taxels fit, and {axes[2]} "
                f"channels of {axes[0]}×{axes[1]}, too"
            )
    elif len(axes) == 2 and 3 in axes and axes != [3, 3]:
        count, last = 3, axes[1] == 3
        proposal.table["shape"] = _shape(proposal, axes[0] if last else axes[1])
        names = ["taxels", "channels"] if last else ["channels", "taxels"]
    elif len(axes) == 2:
        proposal.table["shape"], count = tuple(axes), 1
        names = ["rows", "cols channels"]
    elif len(axes) == 1:
        count = _channels(proposal, axes[0])
        proposal.table["shape"] = _shape(proposal, axes[0] // count)
        names = ["rows cols channels"]
    else:
        raise CodecError(
            f"A frame of the shape {tuple(shape)} does not consist of rows, columns and channels."
        )
    _said_channels(proposal, count)
    return names


def _order(proposal: Proposal, names: list[str], before: int) -> None:
    """Set the order of axes, where the first `before` names come before the frames."""
    order = " ".join([*names[:before], "frames", *names[before:]])
    if order == "frames channels rows cols":
        order = "channels-first"
    if before or names[0] == "channels":
        proposal.table["order"] = order


def _frames_axis(
    proposal: Proposal, shape: Sequence[int], timed: Collection[int], values: Callable[[], Floats]
) -> int:
    """Return which axis of an array counts its frames.

    It is one as long as the times. Without times it is the first, unless another is `CLEARLY`
    longer than each of the rest; of two axes the numbers of a frame must fit a known shape, and
    where both do, time is the axis along which the values change less.
    """
    if len(clocked := [n for n, size in enumerate(shape) if size in timed]) == 1:
        return clocked[0]
    if clocked:  # two fit: the first, or the last of Fortran's order
        last = 0 not in clocked or (len(shape) > 2 and max(shape) == shape[-1] > 8 * shape[0])
        return clocked[-1] if last else 0
    longest = max(range(len(shape)), key=lambda n: shape[n])
    rest = max(size for n, size in enumerate(shape) if n != longest)
    if longest == 0 or shape[longest] < CLEARLY * rest:
        return 0
    result = longest
    if len(shape) == 2 and _usual(shape[1]):
        if not _usual(shape[0]):
            result = 0
        else:
            held = values()
            steps = [_mean_step(held, axis) for axis in (0, 1)]
            result = 0 if steps[0] < steps[1] else longest
    other = 0 if result else longest
    proposal.undecided.append(
        f"order: of {tuple(shape)} the axis of {shape[result]} is taken as the frames, not that of "
        f"{shape[other]}"
    )
    return result


def _mean_step(values: Floats, axis: int) -> float:
    held = np.where(np.isfinite(values), values, np.nan)
    steps = np.abs(np.diff(held, axis=axis))
    steps = steps[np.isfinite(steps)]
    return float(steps.mean()) if steps.size else math.inf


def _usual(numbers: int) -> bool:
    """Return whether a frame of a square or known array has this count of numbers."""
    counts = {numbers, numbers // 3} if numbers % 3 == 0 else {numbers}
    return any(math.isqrt(n) ** 2 == n or n in KNOWN_SHAPES for n in counts)


def _time_unit(name: str, values: Floats, *, asked: bool = False) -> str:
    """Return the unit of times by their name or their steps; "" where they are no times."""
    steps = np.diff(values)
    ahead = steps[steps > 0.0]
    if not len(ahead) or (steps < 0.0).mean() > 0.05:
        return ""
    for unit, words in UNIT_WORDS.items():
        if re.search(rf"(?:^|[^a-zA-Zµ])(?:{words})(?:$|[^a-zA-Z])", name, re.IGNORECASE):
            return unit
    for unit, least in (("ns", 1e17), ("us", 1e14), ("ms", 1e11), ("s", 1e8)):
        if abs(float(values[0])) >= least:  # since 1970
            return unit
    rate = rate_of(values)
    if rate == 1.0 and (steps == 1.0).all() and not asked:
        return ""  # a counter
    return next((u for u in TIME_UNITS if SLOWEST <= rate / SCALE[u] <= QUICKEST), "s")


def _take_clock(
    proposal: Proposal,
    asked: str,
    named: Iterable[str],
    others: Iterable[str],
    read: Callable[[str], Floats],
) -> str:
    """Set the time and its unit by the first column that fits, and return its name.

    Without one it is said why those that are named as times do not, or which of the others rises.
    """
    why = ""
    for name in (asked,) if asked else named:
        values = read(name)
        if not np.isfinite(values).all():
            missing = f"'{name}' has rows without a time: fill them, or"
            why = why or missing
            continue
        if unit := _time_unit(name, values, asked=bool(asked)):
            proposal.table |= {"time": name, "time_unit": unit}
            return name
        steps = np.diff(values)
        if len(steps) and (steps == 1.0).all():
            why = why or (
                f"'{name}' counts up by one: if these are ms, give '--set time={name} --set "
                "time_unit=ms', and if they are the numbers of the frames,"
            )
        elif len(steps):
            same = bool((steps == 0.0).all())
            fault = "is the same in every row" if same else "goes back again and again"
            why = why or f"the times in '{name}' are none, as it {fault}:"
    for name in () if why or asked else others:
        values = read(name)
        if len(values) > 2 and np.isfinite(values).all() and (np.diff(values) > 0.0).all():
            unit = _time_unit(name, values, asked=True)
            why = (
                f"'{name}' rises from row to row: if it is the time, give '--set time={name} "
                f"--set time_unit={unit}', and if not,"
            )
            break
    _no_rate(proposal, why or "the file has no times:")
    return ""


def _no_rate(proposal: Proposal, why: str = "the file has no times:") -> None:
    proposal.undecided.append(f"rate: {why} give it, as in '--set rate=60'")


def _unit(proposal: Proposal, names: Iterable[str], whole: bool) -> None:
    for name in names:
        for word in re.findall(r"[\(\[]\s*([A-Za-z]+)\s*[\)\]]", name):
            if word.lower() in UNITS or word in UNITS:
                proposal.table["unit"] = UNITS.get(word, UNITS.get(word.lower(), word))
                return
    proposal.table["unit"] = "count"
    if not whole:
        proposal.undecided.append("unit: the file does not say it; 'count' has no scale")


# arrays: NumPy, HDF5, Parquet


def _of_arrays(
    path: Path, shapes: Mapping[str, tuple[tuple[int, ...], str]], asked: str
) -> Proposal:
    proposal = Proposal()
    numeric = {
        name: shape
        for name, (shape, kind) in shapes.items()
        if re.search(r"int|float|double|halffloat|uint|bool|list|[<>|=]?[fiub]\d", kind)
        and "string" not in kind
    }
    clocks = {n: s for n, s in numeric.items() if max(s, default=0) == math.prod(s) and s}
    frames = {n: s for n, s in numeric.items() if len(s) > 1 and n not in clocks}
    if not frames:
        flat = [name for name in clocks if not TIME.search(name.rpartition("/")[2])]
        if path.suffix.lower() == PARQUET and len(flat) > 1:
            return _of_columns(path, list(shapes), numeric, asked)
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
    others = [other for other in frames if other != name and LIKELY.search(other)]
    if others:
        proposal.undecided.append(
            f"values: '{name}' is taken of {', '.join(map(repr, (name, *others[:6])))}"
        )
    shape = frames[name]
    at = _frames_axis(proposal, shape, lengths, lambda: _one_array(path, name).reshape(shape))
    count = shape[at]
    names = _of_axes(proposal, (*shape[:at], *shape[at + 1 :]))
    _order(proposal, names, sum(size > 1 for size in shape[:at]))
    if path.suffix.lower() != ".npy":
        proposal.table = {"values": name, **proposal.table}
    proposal.seen.append(f"{count} frames in '{name}' {shape}" if name else f"{count} frames")
    times = [n for n, s in clocks.items() if math.prod(s) == count]
    times.sort(key=lambda n: (not TIME.search(n.rpartition("/")[2]), len(n)))
    known = [n for n in times if TIME.search(n.rpartition("/")[2])]
    others = [n for n in times if not COUNTER.search(n.rpartition("/")[2])]
    if not asked or asked in clocks:
        _take_clock(proposal, asked, known[:1], others[:8], lambda n: _one_array(path, n))
    _unit(proposal, (name,), "int" in shapes[name][1] or "u" in shapes[name][1][:2])
    return proposal


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


def _of_columns(
    path: Path, names: list[str], numeric: Mapping[str, tuple[int, ...]], asked: str
) -> Proposal:
    """Return the layout of a Parquet file with a column a number, as of a table in text."""
    proposal = Proposal()
    columns = [name for name in names if name in numeric]
    known = [name for name in columns if TIME.search(name)]
    others = [name for name in columns[:1] if not COUNTER.search(name)]
    asked = asked if asked in columns else ""
    clock = _take_clock(proposal, asked, known, others, lambda name: _one_array(path, name))
    rest = [name for name in columns if name != clock and not COUNTER.search(name)]
    rest = [name for name in rest if name not in known]
    family = _family(rest)
    _name_columns(proposal, family, rest, listed=True)
    _unit(proposal, rest, False)
    return proposal


# messages


def _of_messages(path: Path, topic: str, asked: str) -> Proposal:
    proposal = Proposal()
    found: dict[str, list[tuple[str, tuple[int, ...]]]] = {}
    with closing(messages(path, topic)) as every:
        for message in islice(every, LOOKED_AT):
            if message.topic not in found:
                try:
                    found[message.topic] = list(numeric_fields(message.content()))
                except CnnumError as error:
                    if path.suffix.lower() in LINES:
                        raise
                    found[message.topic] = []
                    proposal.undecided.append(f"topic '{message.topic}': {error}")
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
    if len({one[3] for one in ranked}) > 1:
        proposal.undecided.append(
            f"topic: '{name}' is taken of {', '.join(sorted({repr(one[3]) for one in ranked}))}"
        )
    proposal.table = {"topic": name} if name else {}
    proposal.table["values"] = part
    _of_axes(proposal, shape)
    if not name:  # lines of JSON have no time of their own
        _line_times(path, proposal, asked)
    proposal.seen.append(f"'{part}' {shape} in each message")
    _unit(proposal, (part,), False)
    return proposal


def _line_times(path: Path, proposal: Proposal, asked: str) -> None:
    with closing(messages(path, "")) as every:
        some = [message.content() for message in islice(every, LOOKED_AT)]
    stamps = [set(pair) for pair in STAMPS]
    for name in _paths(some[0]):
        if asked in ("", name) and set(names_of(part_of(some[0], name))) in stamps:
            proposal.table["time"] = name
            return
    for name in names_of(some[0]):
        held = [part_of(one, name) for one in some if name in names_of(one)]
        wanted = name == asked if asked else TIME.search(name)
        if wanted and all(isinstance(one, int | float) for one in held):
            unit = _time_unit(name, np.array(held, np.float64), asked=bool(asked))
            if unit:
                proposal.table |= {"time": name, "time_unit": unit}
                return
    _no_rate(proposal)


def _paths(content: object, depth: int = 3) -> Iterator[str]:
    """Yield the paths of fields that have fields of their own."""
    for name in names_of(content) if depth else ():
        part = part_of(content, name)
        if names_of(part):
            yield name
            yield from (f"{name}.{deeper}" for deeper in _paths(part, depth - 1))


# bytes as an array sent them


def _sent(path: Path, names: Iterable[str]) -> Proposal | None:
    """Return the layout of a file that holds what an array sent; None where no protocol fits."""
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
        _no_rate(proposal)
    return proposal


def _short(channels: Sequence[str]) -> tuple[str, ...]:
    short = {"shear_x": "x", "shear_y": "y", "normal": "z"}
    return tuple(short.get(name, name) for name in channels)


# tables in text files


def _lines(path: Path) -> list[str] | None:
    """Return the first lines of a text file; None where it is none."""
    try:
        with open_regular(path) as raw:
            begin = raw.read(4096)
            if b"\0" in begin and not begin.startswith((b"\xff\xfe", b"\xfe\xff")):
                return None
            raw.seek(0)
            wide = begin.startswith((b"\xff\xfe", b"\xfe\xff"))
            with TextIOWrapper(raw, "utf-16" if wide else "utf-8-sig", newline="") as text:
                return [line for line in (text.readline(LONGEST) for _ in range(LOOKED_AT)) if line]
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None
    except UnicodeError:
        return None


def _number(text: str, decimal: str) -> bool:
    try:
        float(text.strip().replace(decimal, "."))
    except ValueError:
        return not text.strip() or text.strip().lower() in MISSING
    return "_" not in text


def _of_text(path: Path, lines: list[str], asked: str) -> Proposal:
    begins = {c: sum(x.lstrip().startswith(c) for x in lines) for c in ("#", "%", "//", ";")}
    begins[";"] *= 2 * begins[";"] < len(lines)  # else it stands before an empty first field
    comment = next((c for c, count in begins.items() if count), "#")
    best: tuple[float, int, str, str] = (0.0, 0, ",", ".")
    content = [line for line in lines if line.strip() and not line.lstrip().startswith(comment)]
    if sum(MONITOR.match(line) is not None for line in content) > MOSTLY * len(content):
        raise CodecError(
            f"'{path}' has lines as of Arduino's serial monitor ({content[0][:24].strip()!r}…): "
            "replace ' -> ' by a comma, as \"sed 's/ -> /,/'\" does, so that times are a column."
        )
    for separator in (",", *SEPARATORS):
        rows = [fields for fields in fields_of(content, TextForm(separator)) if any(fields)]
        rows = [_stripped(fields) for fields in rows]
        width, often = Counter(map(len, rows)).most_common(1)[0] if rows else (0, 0)
        wide = [fields for fields in rows if len(fields) == width]
        for decimal in (".", ","):
            numbers = sum(
                _number(text, decimal) or nanoseconds(text) is not None
                for fields in wide
                for text in fields
            )
            share = numbers / max(1, width * len(wide)) * often / max(1, len(rows))
            # equal shares: the more fields the better, and the point before the comma
            if width > 1 and (round(share, 3), width) > (round(best[0], 3), best[1]):
                best = share, width, separator, decimal
    share, width, separator, decimal = best
    if not width:
        width = 1
    block = _block(lines, separator, decimal)
    if block is not None:
        return block
    if share < 0.5:
        raise _no_table(path)
    return _of_table(path, lines, TextForm(separator, decimal, comment=comment), width, asked)


def _stripped(fields: list[str]) -> list[str]:
    while len(fields) > 1 and not fields[-1].strip():
        fields = fields[:-1]
    return fields


def _no_table(path: Path) -> CodecError:
    return CodecError(
        f"'{path}' shows no table of numbers: expected rows of fields between commas, "
        "semicolons, tabs or blanks."
    )


def _of_table(path: Path, lines: list[str], form: TextForm, width: int, asked: str) -> Proposal:
    proposal = Proposal()
    numeric = 0
    rows: list[list[str]] = []
    header, skip, said = "", 0, False
    for number, line in enumerate(lines):
        is_comment = line.lstrip().startswith(form.comment)
        bare = line.lstrip().removeprefix(form.comment) if is_comment else line
        fields = _stripped(next(iter(fields_of([bare], form)), [""]))
        numbers = [_number(text, form.decimal) for text in fields]
        fits = len(fields) in (width, width + 1) and not is_comment
        # the times may be dates
        clocks = [
            not n and nanoseconds(text) is not None for n, text in zip(numbers, fields, strict=True)
        ]
        if fits and sum(numbers) + sum(clocks) >= 0.8 * len(fields) and sum(numbers) > 0:
            rows.append(fields)
            numeric += 1
            continue
        if len(rows) == 1 and len(fields) == len(rows[0]) and not any(numbers):
            raise CodecError(
                f"'{path}', line {number + 1}: names below names, as of columns of two levels in "
                "pandas: give each column one name, as by df.columns = ['_'.join(map(str, c)) for "
                "c in df.columns]."
            )
        if header and len(fields) == width and all(BRACKETS.fullmatch(text) for text in fields):
            raise CodecError(
                f"'{path}', line {number + 1}: units ({fields[0]}, …) below the names of the "
                "columns: delete this line."
            )
        if not rows and len(fields) >= width - 1 and len(fields) > 1 and not all(numbers):
            header, said, skip = bare, is_comment, number
        elif not rows and line.strip() and not is_comment:
            skip = number + 1
    if not rows:  # a lone line of times and numbers may be a header
        raise _no_table(path)
    if header:
        names = [name.strip() for name in _stripped(next(iter(fields_of([header], form))))]
        if said:
            skip = 0
    else:
        names = [str(n + 1) for n in range(len(rows[0]))]
        proposal.table["header"] = False
    if skip:
        proposal.table["skip"] = skip
    for key, value, usual in (
        ("separator", form.separator, ","),
        ("decimal", form.decimal, "."),
        ("comment", form.comment, "#"),
    ):
        if value != usual:
            proposal.table[key] = value
    whole = [fields for fields in rows if len(fields) >= len(names)]
    if not whole:
        raise _no_table(path)
    columns = {name: [fields[n] for fields in whole] for n, name in enumerate(names)}
    _columns(proposal, columns, form.decimal, bool(header), asked)
    proposal.seen.append(f"a table of {len(names)} columns")
    return proposal


def _refuse_long(
    columns: Mapping[str, list[str]], clock: str, values: Mapping[str, Floats]
) -> None:
    """Refuse a table with a row a taxel.

    Raises
    ------
    CodecError
        If a column goes through the same whole numbers at each of its times.
    """
    times = columns.get(clock, [])
    ends = [n for n in range(1, len(times)) if times[n] != times[n - 1]]
    lengths = set(np.diff(ends).tolist())
    if len(ends) < 3 or len(lengths) != 1 or (each := lengths.pop()) < 2:
        return
    for name, numbers in values.items():
        some = numbers[ends[0] : ends[0] + each * (len(ends) - 1)].reshape(-1, each)
        if name != clock and len(set(some[0].tolist())) == each and (some == some[0]).all():
            raise CodecError(
                f"The table has a row a taxel: '{name}' goes through {each} numbers at each time; "
                f"make it a row a frame, as by df.pivot(index='{clock}', columns='{name}') in "
                "pandas, with one name a column."
            )


def _date_forms(texts: list[str]) -> list[str]:
    """Return the forms that dates of a column have other than ISO's, days before months."""
    result: list[str] = []
    for sign, days in product("/.-", ("%d{0}%m{0}%Y", "%m{0}%d{0}%Y", "%d{0}%m{0}%y")):
        for clock in ("%H:%M:%S.%f", "%H:%M:%S,%f", "%H:%M:%S", "%I:%M:%S.%f %p", "%I:%M:%S %p"):
            form = f"{days.format(sign)} {clock}"
            read = by_format(form)
            if all(read(text) is not None for text in texts):
                result.append(form)
    return result


def _columns(
    proposal: Proposal, columns: Mapping[str, list[str]], decimal: str, named: bool, asked: str
) -> None:
    values: dict[str, Floats] = {}
    clock = ""
    for name, texts in columns.items():
        known = [_number(text, decimal) for text in texts]
        if sum(known) > MOSTLY * len(texts):  # its reader names the line of another word
            made = [
                np.nan
                if not good or text.strip().lower() in (*MISSING, "")
                else float(text.replace(decimal, "."))
                for text, good in zip(texts, known, strict=True)
            ]
            numbers = np.array(made)
            values[name] = np.where(np.isfinite(numbers), numbers, np.nan)
        elif clock or asked not in ("", name):
            continue
        elif nanoseconds(texts[0]) is not None:
            clock = name
        elif forms := _date_forms(texts):
            clock, proposal.table["time_format"] = name, forms[0]
            if len(forms) > 1:
                proposal.undecided.append(
                    f"time_format: {texts[0].strip()} is read by '{forms[0]}', and '{forms[1]}' "
                    "fits, too"
                )
    if clock:
        proposal.table["time"] = clock
    elif not asked or asked in values:
        likely = [
            name
            for name, numbers in values.items()
            if (TIME.search(name) if named else (np.diff(numbers) > 0).all())
        ]
        first = [name for name in list(values)[:1] if named and not COUNTER.search(name)]
        clock = _take_clock(proposal, asked, likely, first, values.__getitem__)
    _refuse_long(columns, clock, values)
    rest = [n for n in values if n != clock and not (named and COUNTER.search(n))]
    rest = [n for n in rest if not (TIME.search(n) and named)]
    counters = [
        n for n in rest if len(values[n]) > 2 and (np.diff(values[n]) == 1.0).all() and not named
    ]
    rest = [n for n in rest if n not in counters]
    family = _family(rest) if named else rest
    _name_columns(proposal, family, rest, listed=False)
    if not named and len(family) + bool(clock) < len(columns):
        proposal.table["values"] = tuple(family)
    whole = all((np.nan_to_num(values[n]) % 1.0 == 0.0).all() for n in family)
    _unit(proposal, family, whole)


_PART = re.compile(
    r"\d+|(?:shear|tangential|lateral|force)[ _-]?[xyz](?![^\W\d_])|[^\W\d_]+|[\W_]+", re.IGNORECASE
)
"""Parts of a name: numbers, words, and what stands between; "shear_x" is one word, as "normal"."""


@dataclass(frozen=True, slots=True)
class _Name:
    """A column's name, taken apart: its kind, its numbers, and the word for an axis."""

    kind: tuple[str, ...]
    numbers: tuple[int, ...]
    axis: str
    word: str


def _taken_apart(name: str) -> _Name:
    parts = _PART.findall(name)
    # units in brackets are no words for an axis, and of several words the last is
    end = next((n for n, part in enumerate(parts) if "(" in part or "[" in part), len(parts))
    end = end or len(parts)
    result = [
        (n, axis)
        for n, part in enumerate(parts[:end])
        for axis, words in WORDS.items()
        if re.sub("[ _-]", "", part.lower()) in words
    ]
    at, axis = result[-1] if result else (-1, "")
    kind = ["#" if part.isdigit() else "*" if n == at else part for n, part in enumerate(parts)]
    numbers = tuple(int(part) for part in parts if part.isdigit())
    return _Name(tuple(kind), numbers, axis, parts[at] if result else "")


def _family(names: Sequence[str]) -> list[str]:
    """Return the largest set of columns whose names differ in numbers and an axis alone."""
    sets: dict[tuple[str, ...], list[str]] = {}
    for name in names:
        sets.setdefault(_taken_apart(name).kind, []).append(name)
    if not sets:
        raise CodecError("The table has no columns of numbers besides its times.")
    best = max(sets.values(), key=len)
    return best if len(best) > 1 else list(names)


def _name_columns(
    proposal: Proposal, family: list[str], others: list[str], *, listed: bool
) -> None:
    """Set shape, channels and values by the columns of the taxels."""
    left = [name for name in others if name not in set(family)]
    if left:
        proposal.seen.append(f"left out: {', '.join(left[:8])}{' …' if len(left) > 8 else ''}")
    taken = [_taken_apart(name) for name in family]
    places = [one.numbers for one in taken]
    axes = list(dict.fromkeys(one.axis for one in taken))
    words = list(dict.fromkeys(one.word for one in taken))
    count = len(axes) if all(axes) else 1
    same = len({len(place) for place in places}) == 1 and len({one.kind for one in taken}) == 1
    width = len(places[0])
    varying = [n for n in range(width) if len({place[n] for place in places}) > 1] if same else []
    taxels = len(family) // count
    whole = same and len(set(zip(places, words and [t.axis for t in taken], strict=True))) == len(
        family
    )
    if not (whole and len(varying) in (1, 2) and taxels * count == len(family)):
        count = (
            count if count == 3 and taxels * 3 == len(family) else _channels(proposal, len(family))
        )
        proposal.table["shape"] = _shape(proposal, len(family) // count)
        if not (count > 1 and all(axes)):
            _said_channels(proposal, count)
        else:
            proposal.table["channels"] = tuple(axes)
        if "header" not in proposal.table:
            proposal.table["values"] = tuple(family)
        return
    first = min(place[varying[0]] for place in places)
    if len(varying) == 2:
        highs = [max(place[n] for place in places) for n in varying]
        lows = [min(place[n] for place in places) for n in varying]
        shape = (highs[0] - lows[0] + 1, highs[1] - lows[1] + 1)
        if shape[0] * shape[1] != taxels or lows[0] != lows[1]:
            proposal.table["shape"] = _shape(proposal, taxels)
            _axes_by_name(proposal, axes, words, count)
            proposal.table["values"] = tuple(family)
            return
        proposal.table["shape"] = shape
    else:
        if count == 1:
            split = _channels(proposal, taxels)
            if split > 1:
                proposal.table["shape"] = _shape(proposal, taxels // split)
                _said_channels(proposal, split)
                proposal.table["values"] = tuple(family)
                return
        proposal.table["shape"] = _shape(proposal, taxels)
    _axes_by_name(proposal, axes, words, count)
    if listed:
        by_place = sorted(
            family, key=lambda n: (_taken_apart(n).numbers, axes.index(_taken_apart(n).axis))
        )
        proposal.table["values"] = tuple(by_place)
        return
    pattern = _pattern(family[0], varying)
    if first:
        proposal.table["first"] = first
    proposal.table["values"] = pattern if len(family) > 1 else tuple(family)


def _axes_by_name(proposal: Proposal, axes: list[str], words: list[str], count: int) -> None:
    if count > 1:
        proposal.table["channels"] = tuple(axes)
        if words != axes:
            proposal.table["names"] = tuple(words)
    else:
        proposal.table["channels"] = ("z",) if axes in ([""], ["z"]) else tuple(axes)
        if axes != [""] and words != axes:
            proposal.table["names"] = tuple(words)


def _pattern(name: str, varying: list[int]) -> str:
    """Return the pattern of a family by one of its names."""
    taken = _taken_apart(name)
    places = ("{row}", "{col}") if len(varying) == 2 else ("{n}",)
    made, number = list[str](), 0
    for part, kind in zip(_PART.findall(name), taken.kind, strict=True):
        if kind == "#":
            made.append(places[varying.index(number)] if number in varying else part)
            number += 1
        else:
            made.append("{channel}" if kind == "*" else part)
    return "".join(made)


# blocks of lines


def _block(lines: list[str], separator: str, decimal: str) -> Proposal | None:
    """Return the layout of a text file with a block of lines a frame; None where it has none."""
    form = TextForm(separator, decimal)
    widths: list[int] = []
    for line in lines:
        fields = _stripped(next(iter(fields_of([line], form)), [""]))
        numbers = bool(line.strip()) and all(_number(text, decimal) for text in fields)
        widths.append(len(fields) if numbers and fields != [""] else 0)
    runs: list[tuple[int, int, int]] = []
    for number, width in enumerate(widths):
        if width > 1 and runs and runs[-1][2] == width and runs[-1][1] == number:
            runs[-1] = (runs[-1][0], number + 1, width)
        elif width > 1:
            runs.append((number, number + 1, width))
    inner = runs[:-1] if len(lines) == LOOKED_AT else runs
    lengths = {(end - begin, width) for begin, end, width in inner}
    if len(inner) < 3 or len(lengths) != 1:
        return None
    rows, cols = lengths.pop()
    if rows < 2:
        return None
    proposal = Proposal({"block": True, "shape": (rows, cols), "channels": ("z",)})
    proposal.seen.append(f"a block of {rows} lines a frame")
    if separator != ",":
        proposal.table["separator"] = separator
    if decimal != ".":
        proposal.table["decimal"] = decimal
    head = lines[: inner[0][0]]
    between = [lines[inner[n][1] : inner[n + 1][0]] for n in range(len(inner) - 1)]
    _block_times(proposal, head, between)
    words = " ".join(head).lower()
    unit = next(
        (u for w, u in UNITS.items() if re.search(rf"units?\W+{re.escape(w)}(?![\w/²^*])", words)),
        "",
    )
    proposal.table["unit"] = unit or "count"
    said = re.search(r"units?[\s:;,=]+([^\s,;:]+)", " ".join(head), re.IGNORECASE)
    if not unit and said:
        proposal.undecided.append(
            f"unit: the file says {said[1]!r:.40}, none of {', '.join(UNITS.values())}: taken as "
            "counts, which have no scale"
        )
    elif not unit:
        proposal.undecided.append("unit: the file does not say it; 'count' has no scale")
    return proposal


def _block_times(proposal: Proposal, head: list[str], between: list[list[str]]) -> None:
    for line in head:
        match = re.search(
            r"(seconds_per_frame|frame.?rate|frames.?per.?second|frequency)\W+([\d.]+)", line, re.I
        )
        if match and float(match[2]) > 0.0:
            value = float(match[2])
            proposal.table["rate"] = 1.0 / value if match[1].lower().startswith("sec") else value
            return
    from cnnum.drivers.own_data.sources import stamp

    for line in between[0]:
        for word in re.findall(r"[A-Za-z][A-Za-z _]*", line):
            if not TIME.search(word):
                continue
            times = [
                next((t for one in some if (t := stamp(word, one)) is not None), None)
                for some in between
            ]
            known = [t for t in times if t is not None]
            if len(known) == len(between) and known == sorted(known) and known[0] != known[-1]:
                clock = ":" in line.partition(word)[2].strip(" :,;=\t")
                unit = "s" if clock else _time_unit(word, np.array(known))
                if not unit:
                    continue
                proposal.table["time"] = word.strip()
                if unit != "s":
                    proposal.table["time_unit"] = unit
                return
    _no_rate(proposal)
