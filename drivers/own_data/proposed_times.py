"""The times and the units of a file: which numbers are times, in which unit, and of what."""

import re
from collections.abc import Callable, Collection, Iterable
from itertools import product

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.own_data.proposed_shape import Proposal
from cnnum.drivers.text_table import by_format
from cnnum.recordings.times import rate_of

TIME = re.compile(
    r"(?:^|[^a-z])(?:ts|times?|stamps?|timestamps?|clock|seconds|[mun]s|[mun]?secs?|elapsed|epoch"
    r"|ticks?|unix|milli(?:s|seconds?)|micro(?:s|seconds?)|nano(?:s|secs?|seconds?)|zeit|zeitstempel|temps|tiempo)(?:$|[^a-z])"
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

COUNTER = re.compile(
    r"^(?:|__index_level_\d+__|unnamed: ?\d+|index|frame|frame.?(?:no|nr|id|index|number)|seq"
    r"|sequence|n|#)$",
    re.IGNORECASE,
)
UNITS = {"N": "N", "n": "N", "kpa": "kPa", "pa": "Pa", "v": "V", "mv": "mV", "psi": "psi"}
TIME_UNITS = ("s", "ms", "us", "ns")
SCALE = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

SLOWEST, QUICKEST = 2.0, 5000.0
"""Hz of an array, for the unit of times that do not say it."""


def unit_of_times(name: str, values: Floats, *, asked: bool = False) -> str:
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


def take_clock(
    proposal: Proposal,
    asked: str,
    named: Iterable[str],
    others: Iterable[str],
    read: Callable[[str], Floats],
    stamped: Collection[str] = (),
) -> str:
    """Set the time and its unit by the first column that fits, and return its name.

    Those that are `stamped` are times by their type, in ns.
    Without one it is said why those that are named as times do not, or which of the others rises.
    """
    why, named = "", list(named)
    for name in (asked,) if asked else named:
        values = read(name)
        if not np.isfinite(values).all():
            missing = f"'{name}' has rows without a time: fill them, or"
            why = why or missing
            continue
        unit = unit_of_times(name, values, asked=bool(asked))
        if unit and not asked and (part := _fraction_of(values, named, read)):
            ask_rate(
                proposal,
                f"the times are in two columns: make one of them, as by df['t'] = df['{name}'] + "
                f"1e-9 * df['{part}'] in pandas, if '{part}' is in ns, or",
            )
            return ""
        if unit := "ns" if unit and name in stamped else unit:
            others = (other for other in named if other != name)
            rising = [name, *(n for n in others if unit_of_times(n, read(n)))]
            if len(rising) > 1 and not asked:
                of = ", ".join(map(repr, rising))
                proposal.undecided.append(f"time: '{name}' is taken of {of}")
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
            unit = unit_of_times(name, values, asked=True)
            why = (
                f"'{name}' rises from row to row: if it is the time, give '--set time={name} "
                f"--set time_unit={unit}', and if not,"
            )
            break
    ask_rate(proposal, why or "the file has no times:")
    return ""


def _fraction_of(
    seconds: Floats, named: Iterable[str], read: Callable[[str], Floats]
) -> str | None:
    """Return the column of the fractions of whole seconds, which falls where these go on."""
    ahead = np.diff(seconds) > 0.0
    if (seconds % 1.0 != 0.0).any() or ahead.all():
        return None
    for name in named:
        steps = np.diff(read(name))
        if (steps[~ahead] > 0.0).all() and (steps[ahead] < 0.0).all():
            return name
    return None


def ask_rate(proposal: Proposal, why: str = "the file has no times:") -> None:
    """Say that the rate is to be given."""
    proposal.undecided.append(f"rate: {why} give it, as in '--set rate=60'")


def take_unit(proposal: Proposal, names: Iterable[str], whole: bool) -> None:
    """Set the unit of values by the names of their columns; `whole` where all are whole numbers."""
    for name in names:
        for word in re.findall(r"[\(\[]\s*([A-Za-z]+)\s*[\)\]]", name):
            if word.lower() in UNITS or word in UNITS:
                proposal.table["unit"] = UNITS.get(word, UNITS.get(word.lower(), word))
                return
    proposal.table["unit"] = "count"
    if not whole:
        proposal.undecided.append("unit: the file does not say it; 'count' has no scale")


CLOCKS = ("%H:%M:%S.%f", "%H:%M:%S,%f", "%H:%M:%S", "%I:%M:%S.%f %p", "%I:%M:%S %p")
"""Forms of the time of day behind a date."""


CLOCK = re.compile(r"\d:\d\d")
"""What all of them have, and no number."""

COMPACT = re.compile(
    r"\s*(?:19|20)\d\d(?:0[1-9]|1[0-2])(?:0[1-9]|[12]\d|3[01])([_ T-]?)"
    r"(?:[01]\d|2[0-3])[0-5]\d[0-5]\d(?:[._-]?\d+)?\s*"
)
"""Dates and times in digits alone, which as numbers of ns would run wrongly."""


def date_forms(texts: list[str]) -> list[str]:
    """Return the forms that dates of a column have other than ISO's, days before months."""
    result = list[str]()
    if (first := COMPACT.match(texts[0])) is not None and all(map(COMPACT.fullmatch, texts)):
        rest = [f"{sign}%f" for sign in ("", ".", "_", "-")]
        forms = [f"%Y%m%d{first[1]}%H%M%S{part}" for part in ("", *rest)]
    elif not all(CLOCK.search(text) for text in texts):
        return result
    else:
        forms = _usual_forms()
    for form in forms:
        read = by_format(form)
        if all(read(text) is not None for text in texts):
            result.append(form)
    return result


def _usual_forms() -> list[str]:
    forms = ["%H:%M:%S:%f", "%Y-%m-%d %H:%M:%S:%f", "%M:%S.%f", "%M:%S,%f"]
    for sign, days in product("/.-", ("%d{0}%m{0}%Y", "%m{0}%d{0}%Y", "%d{0}%m{0}%y")):
        for clock in CLOCKS:
            forms.append(f"{days.format(sign)} {clock}")
    words = ("%d. %b %Y", "%d %b %Y", "%d-%b-%Y", "%b %d %Y", "%b %d, %Y")
    return forms + [f"{days} {clock}" for days in words for clock in CLOCKS]
