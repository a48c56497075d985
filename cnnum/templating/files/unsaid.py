"""What a format of another program has no words for, as comments that cnnum reads back.

A line is ``% cnnum: key = value`` with a key and a value of the TOML format. The numbers of a
template are never among them: they stand where the other program reads them.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

from cnnum.errors import TemplateError
from cnnum.safety.reading import parse_toml
from cnnum.templating.files.entry import Entry, FileFormat
from cnnum.templating.files.toml_format import TOML

CARRIED = (
    *("name", "aliases", "description", "source", "input", "state", "tags", "experimental"),
    *("published_boundary", "boundary", "input_boundary", "initial", "duration", "tau", "output"),
    "needs_state",
    *("check", "proof", "measured"),
)
"""Keys that comments carry; words first, then what changes a run."""

WORDS = frozenset(CARRIED[:9]) | {"check", "proof", "measured", "needs_state"}
"""Those of them that change no run."""

_LINE = re.compile(r"^[ \t]*%+[ \t]*cnnum:[ \t]*(\w+)[ \t]*=[ \t]*(.+?)[ \t]*$", re.MULTILINE)


def unsaid(entry: Entry, form: FileFormat, text: str) -> dict[str, object]:
    """Return what is lost where a template's text is read again: key to value.

    Parameters
    ----------
    entry : Entry
    form : FileFormat
        Format that wrote the text.
    text : str
    """
    # some formats take the name from the file, which may come to have another one
    own, there = _table(entry), _table(form.read(text, f"unnamed{form.suffix}"))
    return {
        key: own[key]
        for key in CARRIED
        if key in own and (key not in there or own[key] != there[key])
    }


def comments(values: Mapping[str, object]) -> str:
    """Return lines of comments that carry values."""
    return "".join(f"% cnnum: {key} = {_value(value)}\n" for key, value in values.items())


def with_comments(entry: Entry, text: str, file: str) -> Entry:
    """Return a template with what the comments of its text say.

    Raises
    ------
    TemplateError
        If a comment holds no value of its key; names the file and the key.
    """
    lines = [match for match in _LINE.finditer(text) if match[1] in CARRIED]
    if not lines:
        return entry
    said = {match[1] for match in lines}
    table = _table(entry)
    for match in lines:
        try:
            table |= parse_toml(f"{match[1]} = {match[2]}")
        except ValueError as error:
            line = text.count("\n", 0, match.start()) + 1
            raise TemplateError(
                f"'{file}', line {line}: the comment has no value of '{match[1]}': {error}."
            ) from None
    written = "".join(f"{key} = {_value(value)}\n" for key, value in table.items())
    guesses = tuple(guess for guess in entry.guesses if guess.key not in said)
    result = TOML.read(written, file)
    # figures and proofs are of the numbers that they were found for
    digest, measured, proof = result.template.digest, result.measured, result.proof
    return replace(
        result,
        guesses=guesses,
        measured=measured if measured and measured.digest == digest else None,
        proof=proof if proof and proof.digest == digest else None,
    )


def _table(entry: Entry) -> dict[str, Any]:
    return parse_toml(TOML.write(entry))


def _value(value: object) -> str:
    """Return a value as TOML writes it on one line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list):
        return "[" + ", ".join(_value(item) for item in cast("list[object]", value)) + "]"
    if isinstance(value, dict):
        pairs = cast("dict[str, object]", value).items()
        return "{" + ", ".join(f"{key} = {_value(item)}" for key, item in pairs) + "}"
    return repr(value)
