"""What the numbers of a file are: shape, channels and order, by axes and names of columns."""

import json
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.errors import CodecError
from cnnum.recordings.press_shape import READINGS, reading_shown, shape_shown, shapes_of
from cnnum.recordings.recording import Recording

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
    shapes : list of (rows, cols)
        Those that the taxels may have; none where the file says it.
    numbers : int
        Numbers of a frame, if only their count is known; otherwise 0.
    usual : bool
        Whether the shape is that of a usual array, and not one of several that are as likely.
    part : bool
        Whether the names of the taxels leave out numbers, as where columns were cut from a table.
    """

    table: dict[str, object] = field(default_factory=dict[str, object])
    shapes: list[Shape] = field(default_factory=list[Shape])
    usual: bool = True
    part: bool = False
    numbers: int = 0
    undecided: list[str] = field(default_factory=list[str])
    seen: list[str] = field(default_factory=list[str])

    def asks(self, key: str) -> bool:
        """Return whether a key is to be given."""
        return any(said.startswith(f"{key}: ") for said in self.undecided)

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
    if isinstance(value, dict):
        pairs = cast("dict[str, object]", value).items()
        return "{" + ", ".join(f"{key} = {toml_text(item)}" for key, item in pairs) + "}"
    return repr(value)


def shape_of(proposal: Proposal, taxels: int, sure: bool = False) -> tuple[int, int]:
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
        proposal.shapes = shapes_of(taxels)
        proposal.usual = shape[0] == shape[1] or taxels in KNOWN_SHAPES or len(proposal.shapes) < 2
        proposal.undecided.append(
            f"shape: {taxels} taxels are taken as {shape[0]} rows of {shape[1]}, from left to right"
        )
    return shape


def take_channels(proposal: Proposal, count: int) -> None:
    """Set the shape anew for a count of channels that is given."""
    if proposal.numbers and count and proposal.numbers % count == 0:
        proposal.undecided = [s for s in proposal.undecided if not s.startswith("shape: ")]
        proposal.shapes = []
        proposal.table["shape"] = shape_of(proposal, proposal.numbers // count)
    proposal.numbers = 0


def settle_shape(proposal: Proposal, recording: Recording | None) -> bool:
    """Set shape and channels by the presses of a recording, and return whether they are known then.

    Unless they show it, it is that of a usual array, and else there is none.
    """
    if not proposal.shapes:
        return True
    if recording is not None and proposal.numbers % 3 == 0 < proposal.numbers and not proposal.part:
        recording = _settle_channels(proposal, recording)
    rest = [said for said in proposal.undecided if not said.startswith("shape: ")]
    seen = None if proposal.part else recording
    shown = None if seen is None else shape_shown(seen, proposal.shapes)
    taxels = math.prod(proposal.shapes[0])
    if shown is not None:
        proposal.table["shape"] = shown
        proposal.seen.append(f"presses that show {shown[0]} rows of {shown[1]} taxels")
        said = f"shape: by the presses, {taxels} taxels are {shown[0]} rows of {shown[1]}"
    elif proposal.part:
        proposal.table.pop("shape")
        said = (
            f"shape: the names of the {taxels} taxels leave out numbers, so that they seem to be a "
            "part of an array: give their rows and columns, as in '--set shape=[1, "
            f"{taxels}]', or their 'positions' as well"
        )
    elif proposal.usual:
        return True
    else:
        names = [f"{rows}×{cols}" for rows, cols in proposal.shapes]
        proposal.table.pop("shape")
        said = (
            f"shape: {taxels} taxels may be {', '.join(names[:-1])} or {names[-1]} (rows×columns), "
            "and no press shows which: give it, as in '--set shape=[1, "
            f"{taxels}]'"
        )
    proposal.undecided = [said, *rest]
    return shown is not None


def _settle_channels(proposal: Proposal, recording: Recording) -> Recording:
    """Set the channels of numbers of which only the count is known by presses, where they show."""
    reading, numbers = reading_shown(recording), proposal.numbers
    if not reading:
        return recording
    proposal.undecided = [said for said in proposal.undecided if not said.startswith("channels: ")]
    count = 1 if reading == READINGS[2] else 3
    take_channels(proposal, count)
    name_channels(proposal, count)
    proposal.seen.append(f"presses that show {count} channels of {numbers // count} taxels")
    values = recording.values.reshape(len(recording), 1, -1, count)
    if reading == READINGS[1]:
        proposal.table["order"] = "channels-first"
        values = recording.values.reshape(len(recording), 1, 3, -1).transpose(0, 1, 3, 2)
    said = f"channels: by the presses, {numbers} numbers are {numbers // count} taxels of {count}"
    proposal.undecided.insert(0, said + f", {reading}" * (count > 1))
    names = ("x", "y", "z")[-count:]
    return replace(recording, values=values, channels=names)


def channels_of(proposal: Proposal, numbers: int) -> int:
    """Return how many numbers a taxel has."""
    root = math.isqrt(numbers)
    third = numbers // 3
    if (numbers % 3 == 0 and (math.isqrt(third) ** 2 == third or third in KNOWN_SHAPES)) or (
        numbers % 3 == 0 and root * root != numbers and numbers not in KNOWN_SHAPES
    ):
        count = 3
    else:
        count = 1
    proposal.numbers = numbers
    other = 4 - count  # three or one
    more = f", and may be {numbers // other} of {other}: then give '--set channels="
    more += '["z"]' if other == 1 else '["x", "y", "z"]'
    proposal.undecided.append(
        f"channels: {numbers} numbers a frame are taken as {numbers // count} taxels of {count}"
        + (f"{more}'" if numbers % other == 0 else "")
    )
    return count


def name_channels(proposal: Proposal, count: int) -> None:
    """Set the names of a number of channels, and say what is not known of them."""
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


def take_axes(proposal: Proposal, shape: Sequence[int]) -> list[str]:
    """Set shape and channels by the axes of a frame, and return what each long axis is."""
    axes = [size for size in shape if size > 1] or [1]
    few = (2, 3, 4, 6)
    if len(shape) == 3 and 1 in shape[:2] and max(shape[:2]) > 1 and shape[2] == 3:
        # a strip, with its one row or column as an axis
        count, names = 3, ["rows", "cols", "channels"]
        proposal.table["shape"] = tuple(shape[:2])
    elif len(axes) == 3 and (axes[0] in few or axes[2] in few):
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
        proposal.table["shape"] = shape_of(proposal, axes[0] if last else axes[1])
        names = ["taxels", "channels"] if last else ["channels", "taxels"]
    elif len(axes) == 2:
        proposal.table["shape"], count = tuple(axes), 1
        names = ["rows", "cols channels"]
    elif len(axes) == 1:
        count = channels_of(proposal, axes[0])
        proposal.table["shape"] = shape_of(proposal, axes[0] // count)
        names = ["rows cols channels"]
    else:
        raise CodecError(
            f"A frame of the shape {tuple(shape)} does not consist of rows, columns and channels."
        )
    name_channels(proposal, count)
    return names


def take_order(proposal: Proposal, names: list[str], before: int, turned: bool) -> None:
    """Set the order of axes, where the first `before` names come before the frames.

    Where they are `turned`, the file has them in the opposite order.
    """
    order = " ".join([*names[:before], "frames", *names[before:]])
    if turned:
        proposal.table["order"] = " ".join(reversed(order.split()))
        return
    if order == "frames channels rows cols":
        order = "channels-first"
    if before or names[0] == "channels":
        proposal.table["order"] = order


def frames_axis(
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
    # (a number in brackets is no unit)
    opened = (n for n, part in enumerate(parts) if "(" in part or "[" in part)
    end = next((n for n in opened if not "".join(parts[n + 1 : n + 2]).isdigit()), len(parts))
    end = end or len(parts)
    placed = _XY.search(name) is not None  # "x3_y0" is a place
    result = [
        (n, axis)
        for n, part in enumerate(parts[:end])
        for axis, words in WORDS.items()
        if not (placed and part.lower() in "xy")
        if re.sub("[ _-]", "", part.lower()) in words
    ]
    at, axis = result[-1] if result else (-1, "")
    kind = ["#" if part.isdigit() else "*" if n == at else part for n, part in enumerate(parts)]
    numbers = tuple(int(part) for part in parts if part.isdigit())
    return _Name(tuple(kind), numbers, axis, parts[at] if result else "")


_XY = re.compile(r"(?<![^\W_])x[\W_]*\d+[\W_]*y[\W_]*\d", re.IGNORECASE)

_COLS = re.compile(
    r"(?:.*[\W_])?(?:c(?:ols?|olumns?)?|x)[\W_]*#[\W_]*(?:r(?:ows?)?|y)[\W_]*#[^#]*", re.I
)
"""The kind of a name with a column before a row, such as "c3_r0" or "x3_y0"."""

_ROW = re.compile(r"(?<![^\W_])r(?:ow)?[\W_]*\d+$", re.IGNORECASE)

_GRID = re.compile(r"(?:.*[\W_])?r(?:ows?)?[\W_]*#[\W_]*c(?:ols?|olumns?)?[\W_]*#[^#]*", re.I)
"""The kind of a name with a row and a column, such as "r0_c3_x"."""

_SENSORS = re.compile(
    r"(?:.*[\W_])?(?:s|sensor|pad|finger|module|patch|skin|board|unit|tip|hand|device)[\W_]*#[\W_]*"
    r"[a-z]+[\W_]*#", re.I
)  # fmt: skip
"""The begin of that with a sensor and a taxel of it, such as "S0_T3_x"."""


def _follow(numbers: set[int]) -> bool:
    return max(numbers) - min(numbers) + 1 == len(numbers)


def family_of(names: Sequence[str]) -> list[str]:
    """Return the largest set of columns whose names differ in numbers and an axis alone."""
    sets: dict[tuple[str, ...], list[str]] = {}
    for name in names:
        sets.setdefault(_taken_apart(name).kind, []).append(name)
    if not sets:
        raise CodecError("The table has no columns of numbers besides its times.")
    best = max(sets.values(), key=len)
    if _SENSORS.match("".join(_taken_apart(best[0]).kind)):
        first = min(_taken_apart(name).numbers[0] for name in best)
        best = [name for name in best if _taken_apart(name).numbers[0] == first]
    return best if len(best) > 1 else list(names)


def parts_of_frame(shapes: Mapping[str, tuple[int, ...]]) -> list[str]:
    """Return the fields or arrays that make up a frame together, by their names and shapes.

    There is one per channel, as "x", "y" and "z", one per taxel, as "taxel0", …, or one per row.
    """
    alike: dict[tuple[object, ...], list[str]] = {}
    for name, shape in shapes.items():
        if not shape:
            continue
        taken = _taken_apart(name)
        whose = taken.kind if taken.axis else ()
        alike.setdefault((shape, "axis", whose, taken.numbers), []).append(name)
        if math.prod(shape) == 3 or (len(shape) == 1 and _ROW.search(name)):
            alike.setdefault((shape, "number", taken.kind), []).append(name)
    whole = [
        names
        for (_, by, *_), names in alike.items()
        if len(names) > 1
        and (by == "number" or sorted(_taken_apart(name).axis for name in names) == ["x", "y", "z"])
    ]
    best = max(whole, key=len, default=list[str]())
    return sorted(best, key=lambda name: (_taken_apart(name).numbers, _taken_apart(name).axis))


def take_parts(proposal: Proposal, names: Sequence[str], shape: Sequence[int]) -> None:
    """Set shape, channels and order by parts of one shape that make up a frame."""
    proposal.table["values"] = tuple(names)
    proposal.seen.append(f"{len(names)} parts of a frame, from '{names[0]}' to '{names[-1]}'")
    axes, numbers = [size for size in shape if size > 1], math.prod(shape)
    if all(_taken_apart(name).axis for name in names):
        proposal.table["channels"] = ("x", "y", "z")
        proposal.table["shape"] = tuple(axes) if len(axes) == 2 else shape_of(proposal, numbers)
        proposal.table["order"] = "channels-first"
    elif numbers == 3 and not _ROW.search(names[0]):
        name_channels(proposal, 3)
        proposal.table["shape"] = shape_of(proposal, len(names))
    else:
        proposal.table |= {"shape": (len(names), numbers), "channels": ("z",)}


def name_columns(proposal: Proposal, family: list[str], others: list[str], *, listed: bool) -> None:
    """Set shape, channels and values by the columns of the taxels."""
    left = [name for name in others if name not in set(family)]
    if left:
        proposal.seen.append(f"left out: {', '.join(left[:8])}{' …' if len(left) > 8 else ''}")
        if len(other := family_of(left)) == len(family) > 1:
            proposal.undecided.append(
                f"values: the columns from '{family[0]}' to '{family[-1]}' are taken, and not "
                f"those from '{other[0]}' to '{other[-1]}'"
            )
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
        if count != 3 or taxels * 3 != len(family):
            count = channels_of(proposal, len(family))
        proposal.table["shape"] = shape_of(proposal, len(family) // count)
        if not (count > 1 and all(axes)):
            name_channels(proposal, count)
        else:
            proposal.table["channels"] = tuple(axes)
        if "header" not in proposal.table:
            proposal.table["values"] = tuple(family)
        return
    first, gaps = min(place[varying[0]] for place in places), False
    kind = "".join(taken[0].kind)
    swapped = _COLS.fullmatch(kind) is not None
    lined = swapped or _GRID.fullmatch(kind) is not None
    if len(varying) == 2 or (lined and width == 2):
        at = varying if len(varying) == 2 else [0, 1]
        rows, cols = ({place[n] for place in places} for n in (reversed(at) if swapped else at))
        if len(rows) * len(cols) != taxels:
            proposal.table["shape"] = shape_of(proposal, taxels)
            _axes_by_name(proposal, axes, words, count)
            proposal.table["values"] = tuple(family)
            return
        proposal.table["shape"] = len(rows), len(cols)
        gaps = min(rows) != min(cols) or not _follow(rows) or not _follow(cols)
        varying = at
    else:
        if count == 1:
            split = channels_of(proposal, taxels)
            if split > 1:
                proposal.table["shape"] = shape_of(proposal, taxels // split)
                name_channels(proposal, split)
                proposal.table["values"] = tuple(family)
                return
        proposal.table["shape"] = shape_of(proposal, taxels)
        gaps = not _follow({place[varying[0]] for place in places})
        if gaps:  # a part of an array
            proposal.usual, proposal.part = False, True
    _axes_by_name(proposal, axes, words, count)
    padded = any(re.search(r"(?<!\d)0\d", name) for name in family)
    if listed or gaps or padded:
        by_place = sorted(
            zip(taken, family, strict=True),
            key=lambda one: (
                one[0].numbers[::-1] if swapped else one[0].numbers, axes.index(one[0].axis)
            ),
        )  # fmt: skip
        proposal.table["values"] = tuple(name for _, name in by_place)
        return
    pattern = _pattern(family[0], varying, swapped)
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


def _pattern(name: str, varying: list[int], swapped: bool) -> str:
    """Return the pattern of a family by one of its names."""
    taken = _taken_apart(name)
    places = ("{row}", "{col}") if len(varying) == 2 else ("{n}",)
    places = places[::-1] if swapped else places
    made, number = list[str](), 0
    for part, kind in zip(_PART.findall(name), taken.kind, strict=True):
        if kind == "#":
            made.append(places[varying.index(number)] if number in varying else part)
            number += 1
        else:
            made.append("{channel}" if kind == "*" else part)
    return "".join(made)
