"""The layout of a text file: a table, or a block of lines per frame."""

import csv
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.own_data.proposed_shape import Proposal, family_of, name_columns
from cnnum.drivers.own_data.proposed_times import (
    COMPACT,
    COUNTER,
    TIME,
    UNITS,
    ask_rate,
    date_forms,
    take_clock,
    take_unit,
    unit_of_times,
)
from cnnum.drivers.own_data.sources import stamp
from cnnum.drivers.text_table import (
    MISSING,
    SEPARATORS,
    TextForm,
    fields_of,
    groups,
    nanoseconds,
    open_text,
    read_line,
)
from cnnum.errors import CodecError, RecordingError, unreadable
from cnnum.safety.reading import open_regular

LOOKED_AT, LONGEST = 400, 1 << 22
"""Lines of a text file that are looked at, and letters of one."""

BRACKETS = re.compile(r"\s*[\[(][^\])]*[\])]\s*")
MOSTLY = 0.9
"""Part of a column's fields that are numbers, from which another word in it is a fault."""

TURNS = 3
"""Times that a column goes through its values from which it does so in the whole table."""

SIGNS = re.compile(
    r"\s*[\[({]+\s*[+-]?\.?\d.*|.*\d\s*[\])}]+,?\s*|.*[\])}][:,;=]?\s*[+-]?\d\S*"
    r"|\s*[+-]?[\d.]+[,;|]\W*[+-]?[\d.]+\W*"
)
"""Numbers with brackets, or several of them, in what should be a field."""

MONITOR = re.compile(r"\s*\d+:\d+:\d+[.,]?\d* -> ")
"""What Arduino's serial monitor writes before a line."""


def first_lines(path: Path) -> list[str] | None:
    """Return the first lines of a text file, or None if it is none."""
    try:
        with open_regular(path) as raw:
            begin = raw.read(4096)
            if b"\0" in begin and not begin.startswith((b"\xff\xfe", b"\xfe\xff")):
                return None
            raw.seek(0)
            with open_text(raw) as text:
                return [
                    line for line in (read_line(text, LONGEST) for _ in range(LOOKED_AT)) if line
                ]
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None
    except UnicodeError:
        return None


GROUPED = (
    (".", ","), (",", "."), (".", "'"), (".", "\u2019"), (".", " "), (",", " "), (".", "\u00a0"),
    (",", "\u00a0"), (",", "\u202f"),
)  # fmt: skip
"""Signs in numbers and between their thousands that are tried where numbers are none without."""


def _number(text: str, decimal: str, thousands: str = "") -> bool:
    if thousands and groups(text, thousands, decimal):
        return True
    try:
        float(text.strip().replace(decimal, "."))
    except ValueError:
        return not text.strip() or text.strip().lower() in MISSING
    return "_" not in text


def _fields(lines: list[str], form: TextForm) -> list[list[str]]:
    """Return the fields of each line; none if a field is too long, as without its separator."""
    try:
        return list(fields_of(lines, form))
    except csv.Error:
        return []


def of_text(path: Path, lines: list[str], asked: str) -> Proposal:
    """Return the layout of a text file by its first lines; `asked` is the column of the times."""
    begins = {c: sum(x.lstrip().startswith(c) for x in lines) for c in ("#", "%", "//", ";")}
    begins[";"] *= 2 * begins[";"] < len(lines)  # else it stands before an empty first field
    comment = next((c for c, count in begins.items() if count), "#")
    best = (0.0, 0, ",", ".", "")
    content = [line for line in lines if line.strip() and not line.lstrip().startswith(comment)]
    if sum(MONITOR.match(line) is not None for line in content) > MOSTLY * len(content):
        raise CodecError(
            f"'{path}' has lines in the format of Arduino's serial monitor "
            f"({content[0][:24].strip()!r}…): replace ' -> ' by a comma, as \"sed 's/ -> /,/'\" "
            "does, so that times are a column."
        )
    for separator in (",", *SEPARATORS):
        rows = [fields for fields in _fields(content, TextForm(separator)) if any(fields)]
        rows = [_stripped(fields) for fields in rows]
        width, often = Counter(map(len, rows)).most_common(1)[0] if rows else (0, 0)
        wide = [fields for fields in rows if len(fields) == width]
        dated = {n for n in range(width) if wide and date_forms([wide[-1][n]])}
        for decimal, thousands in ((".", ""), (",", ""), *GROUPED):
            if thousands and (best[0] > 0.999 or thousands == separator == " "):
                break
            numbers = sum(
                _number(text, decimal, thousands) or n in dated or nanoseconds(text) is not None
                for fields in wide
                for n, text in enumerate(fields)
            )
            share = numbers / max(1, width * len(wide)) * often / max(1, len(rows))
            # equal shares: the more fields the better, and the point before the comma
            if width > 1 and (round(share, 3), width) > (round(best[0], 3), best[1]):
                best = share, width, separator, decimal, thousands
    share, width, separator, decimal, thousands = best
    if not width:
        width = 1
    block = _block(lines, separator, decimal)
    if block is not None:
        return block
    if share < 0.5:
        raise _no_table(path)
    form = TextForm(separator, decimal, comment=comment, thousands=thousands)
    proposal = Proposal()
    form = _with_thousands(proposal, content, form)
    return _of_table(path, lines, proposal, form, width, asked)


def _with_thousands(proposal: Proposal, content: list[str], form: TextForm) -> TextForm:
    """Return a form in which commas before three digits are those of thousands, where they are."""
    if form.decimal != "," or form.thousands:
        return form
    fields = [text.strip() for row in fields_of(content, form) for text in row]
    parts = [text for text in fields if text[:1] in tuple("+-0123456789") and ":" not in text]
    commas = [text for text in parts if "," in text]
    plain = [text.lstrip("+-") for text in parts if text.lstrip("+-").isdigit()]
    if not commas or not all(groups(text, ",") for text in commas):
        return form
    if any(text.lstrip("+-").startswith("0") for text in commas):
        return form  # 0,123
    if not any(len(text) < 4 for text in plain):
        taken = ("", ",") if form.separator != "," else (",", "")
        shown = commas[0].replace(",", "" if taken[0] else ".")
        proposal.undecided.append(
            f"thousands: {commas[0]!r} is taken as {shown}, and may be "
            f"{commas[0].replace(',', '.' if taken[0] else '')}: then set thousands = "
            f"'{taken[1]}' and decimal = '{',' if taken[0] else '.'}'"
        )
        if not taken[0]:
            return form
    return replace(form, decimal=".", thousands=",")


def _stripped(fields: list[str]) -> list[str]:
    while len(fields) > 1 and not fields[-1].strip():
        fields = fields[:-1]
    return fields


def _no_table(path: Path) -> CodecError:
    return CodecError(
        f"'{path}' shows no table of numbers: expected rows of fields between commas, "
        "semicolons, tabs or blanks."
    )


def _of_table(
    path: Path, lines: list[str], proposal: Proposal, form: TextForm, width: int, asked: str
) -> Proposal:
    rows: list[list[str]] = []
    header, skip, said = "", 0, False
    for number, line in enumerate(lines):
        is_comment = line.lstrip().startswith(form.comment)
        bare = line.lstrip().removeprefix(form.comment) if is_comment else line
        whole_line = next(iter(_fields([bare], form)), [""])
        fields = _stripped(whole_line)
        numbers = [_number(text, form.decimal, form.thousands) for text in fields]
        fits = len(fields) in (width, width + 1) and not is_comment
        # the times may be dates
        clocks = [
            not n and (nanoseconds(text) is not None or bool(date_forms([text])))
            for n, text in zip(numbers, fields, strict=True)
        ]
        if fits and sum(numbers) + sum(clocks) >= 0.8 * len(fields) and sum(numbers) > 0:
            rows.append(whole_line)
            continue
        if len(rows) == 1 and len(fields) == len(_stripped(rows[0])) and not any(numbers):
            raise CodecError(
                f"'{path}', line {number + 1}: a second row of names, as for columns with two "
                "levels in pandas: give each column one name, as by df.columns = "
                "['_'.join(map(str, c)) for c in df.columns]."
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
        names = [str(n + 1) for n in range(len(_stripped(rows[0])))]
        proposal.table["header"] = False
    if skip:
        proposal.table["skip"] = skip
    for key, value, usual in (
        ("separator", form.separator, ","),
        ("decimal", form.decimal, "."),
        ("thousands", form.thousands, ""),
        ("comment", form.comment, "#"),
    ):
        if value != usual:
            proposal.table[key] = value
    whole = [fields for fields in rows if len(fields) >= len(names)]
    if not whole:
        raise _no_table(path)
    columns: dict[str, list[str]] = {}
    for n, name in enumerate(names):
        texts = [fields[n] for fields in whole]
        if name and columns.get(name, texts) != texts:
            raise CodecError(
                f"'{path}' has two different columns with the name {name!r:.80}: rename one of "
                "them."
            )
        columns.setdefault(name, texts)
    _columns(proposal, columns, form, bool(header), asked)
    proposal.seen.append(f"a table of {len(names)} columns")
    return proposal


def _blocks_of(texts: list[str]) -> list[slice]:
    """Return the runs of rows with the same text."""
    ends = [n for n in range(1, len(texts)) if texts[n] != texts[n - 1]]
    return [slice(begin, end) for begin, end in pairwise([0, *ends, len(texts)])]


def _turns_of(texts: list[str]) -> list[slice]:
    """Return the rows between which the first text comes again."""
    size = next((n for n in range(1, len(texts)) if texts[n] == texts[0]), len(texts))
    return [slice(n, n + size) for n in range(0, len(texts), size)]


def _repeated(texts: list[str], blocks: list[slice]) -> int:
    """Return how many values a column goes through in each block, in one order; 0 if it does not.

    Some rows may be lost. The last block may go on in lines that were not read.
    """
    places = {text: n for n, text in enumerate(dict.fromkeys(texts[max(blocks, key=_rows_in)]))}
    if len(places) < 2 or len(blocks) < TURNS or not places.keys() >= set(texts):
        return 0
    ranks = [[places[text] for text in texts[block]] for block in blocks]
    whole = ranks[:-1] if len(ranks) > TURNS else ranks
    covered = sum(len(set(some)) for some in whole)
    ordered = all(some == sorted(some) for some in ranks)
    return len(places) if ordered and covered > MOSTLY * len(places) * len(whole) else 0


def _rows_in(block: slice) -> int:
    return int(block.stop - block.start)


def _refuse_long(
    proposal: Proposal, columns: Mapping[str, list[str]], clock: str, values: Mapping[str, Floats]
) -> None:
    """Raise if a table has one row per taxel or per sensor, and say so if it only seems to.

    Raises
    ------
    CodecError
        If a column goes through the same words again and again, or through the same whole numbers
        at each of its times.
    """
    rising = (n for n in values if not TIME.search(n) and (np.diff(values[n]) >= 0.0).all())
    keys = [clock] if clock else list(rising)
    # rows of the same time, or of the same frame
    steps = [
        blocks for name in keys if len(blocks := _blocks_of(columns[name])) < len(columns[name])
    ]
    for name, texts in columns.items():
        if name in keys or COUNTER.search(name):
            continue
        counts = [_repeated(texts, blocks) for blocks in steps]
        count = max(counts, default=0) or _repeated(texts, _turns_of(texts))
        if count and (any(counts) or name not in values):
            first = texts[0] if name in values else repr(texts[0])
            raise CodecError(
                f"The table has several rows per frame: '{name}' repeats {count} values; "
                "convert the table to one row per frame, as by "
                f"df.pivot(index='{clock or 'time'}', columns='{name}') in pandas, with one name "
                f"per column, or keep the rows of one value, as by df[df['{name}'] == {first}]."
            )
        if count > 2 and (np.diff(values[name][:count]) == 1.0).all():
            proposal.undecided.append(
                f"rows: each is taken as a frame, and '{name}' counts {count} values again and "
                f"again: if it is the number of a taxel, make a frame of every {count} rows"
            )


def _columns(
    proposal: Proposal, columns: Mapping[str, list[str]], form: TextForm, named: bool, asked: str
) -> None:
    values: dict[str, Floats] = {}
    clock = ""
    for name, texts in columns.items():
        known = [_number(text, form.decimal, form.thousands) for text in texts]
        stamped = not clock and asked in ("", name) and all(map(COMPACT.fullmatch, texts))
        if not stamped and sum(known) > MOSTLY * len(texts):
            # its reader names the line of another word
            made = [
                np.nan if not good or text.strip().lower() in (*MISSING, "") else float(text)
                for text, good in zip(form.plain(texts), known, strict=True)
            ]
            numbers = np.array(made)
            values[name] = np.where(np.isfinite(numbers), numbers, np.nan)
        elif clock or asked not in ("", name):
            continue
        elif nanoseconds(texts[0]) is not None:
            clock = name
        elif forms := date_forms(texts):
            clock, proposal.table["time_format"] = name, forms[0]
            if len(forms) > 1:
                proposal.undecided.append(
                    f"time_format: {texts[0].strip()} is read by '{forms[0]}', and '{forms[1]}' "
                    "fits, too"
                )
        elif not named and sum(map(bool, map(SIGNS.fullmatch, texts))) > MOSTLY * len(texts):
            raise CodecError(
                f"The fields of the table have other signs beside their numbers, as in "
                f"{texts[0].strip()!r:.60}: write plain numbers with one separator between them."
            )
        elif (
            not named
            and name == "1"
            and len(set(texts)) == len(texts) > TURNS
            and not any(known[1:])
        ):
            raise CodecError(
                f"The first column names the rows, as {texts[1].strip()!r:.60}, as where a frame "
                "is a column: turn the table, as by df.T in pandas."
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
        clock = take_clock(proposal, asked, likely, first, values.__getitem__)
    _refuse_long(proposal, columns, clock, values)
    rest = [n for n in values if n != clock and not (named and COUNTER.search(n))]
    rest = [n for n in rest if not (TIME.search(n) and named)]
    counters = [
        n for n in rest if len(values[n]) > 2 and (np.diff(values[n]) == 1.0).all() and not named
    ]
    rest = [n for n in rest if n not in counters]
    family = family_of(rest) if named else rest
    name_columns(proposal, family, rest, listed=False)
    if not named and len(family) + bool(clock) < len(columns):
        proposal.table["values"] = tuple(family)
    whole = all((np.nan_to_num(values[n]) % 1.0 == 0.0).all() for n in family)
    take_unit(proposal, family, whole)


# blocks of lines


def _block(lines: list[str], separator: str, decimal: str) -> Proposal | None:
    """Return the layout of a text file with a block of lines a frame, or None if it has none."""
    form = TextForm(separator, decimal)
    widths: list[int] = []
    for line in lines:
        fields = _stripped(next(iter(_fields([line], form)), [""]))
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
                unit = "s" if clock else unit_of_times(word, np.array(known))
                if not unit:
                    continue
                proposal.table["time"] = word.strip()
                if unit != "s":
                    proposal.table["time_unit"] = unit
                return
    ask_rate(proposal)
