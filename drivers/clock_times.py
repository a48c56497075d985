"""Dates and times of day in text files, as whole nanoseconds."""

import re
from collections.abc import Callable
from datetime import UTC, datetime

FORMS = "2024-05-03 12:00:00.25, 2024-05-03T10:00:00Z and 12:00:00.25"
"""Examples of what is read, for the sentence of an error."""

DAY = 86_400_000_000_000

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_OF_DAY = re.compile(r"(\d{1,3}):([0-5]\d):([0-5]\d|60)(?:[.,](\d{1,9}))?\s*([AaPp][Mm])?")
_FRACTION = re.compile(r"(?<=:\d\d)[.,](\d{1,12})")
_YEAR_FIRST = re.compile(r"(\d{4})/(\d\d)/(\d\d)(?=[ T])")


def nanoseconds(text: str) -> int | None:
    """Return a date with its time, or a time of day, in ns; None where it is neither.

    A date counts from 1970, and is in UTC unless it names another zone. A time of day counts from
    midnight; its hours may go beyond 24.

    Parameters
    ----------
    text : str
        In one of the forms of ISO 8601, with a blank or slashes where loggers write them, or
        hours, minutes and seconds.
    """
    text = text.strip()
    if day := _OF_DAY.fullmatch(text):
        return _of_day(day)
    text = _YEAR_FIRST.sub(r"\1-\2-\3", text).removesuffix(" UTC")
    fraction = _FRACTION.search(text)
    whole = text if fraction is None else text[: fraction.start()] + text[fraction.end() :]
    try:
        found = datetime.fromisoformat(whole)
    except ValueError:
        return None
    if len(whole) < len("20240503T12"):  # a day alone is no time of a frame
        return None
    return _since_epoch(found) + (_part(fraction[1]) if fraction else 0)


def by_format(form: str) -> Callable[[str], int | None]:
    """Return a function as `nanoseconds` for one form.

    Parameters
    ----------
    form : str
        As `datetime.strptime` takes it.
    """

    def read(text: str) -> int | None:
        try:
            return _since_epoch(datetime.strptime(text.strip(), form))
        except ValueError:
            return None

    return read


def _of_day(found: re.Match[str]) -> int:
    hours, minutes, seconds = (int(found[n]) for n in (1, 2, 3))
    if found[5]:
        hours = hours % 12 + (12 if found[5].lower() == "pm" else 0)
    whole = (60 * hours + minutes) * 60 + seconds
    return whole * 1_000_000_000 + (_part(found[4]) if found[4] else 0)


def _part(digits: str) -> int:
    return int(digits[:9].ljust(9, "0"))


def _since_epoch(when: datetime) -> int:
    known = when if when.tzinfo is not None else when.replace(tzinfo=UTC)
    gone = known - _EPOCH
    return (gone.days * 86_400 + gone.seconds) * 1_000_000_000 + gone.microseconds * 1000
