"""Templates as TOML: the format of the library.

Keys: name, A, B, z, tau, boundary, input_boundary, initial, duration, output, description, source,
aliases. The words about it: input, state, tags, experimental, published_boundary. The tables are
[[nonlinear]] (neighbour, weights, interpolation, points, and where needed centre, to, source,
centre_source, times_argument, reversed_sign). Then [[gain]] (to, source, interpolation, points) and
[delayed] (delay, A, B). The table [check] has the name of a closed form and its parameters.
Commands write the tables [measured] and [proof]. Matrices are nested lists of rows, (k, k) or
[to][from][row][col].
"""

from collections.abc import Callable, Mapping
from typing import Any

from cnnum.errors import ArrayError, TemplateError, UnknownNameError
from cnnum.safety.toml_reading import parse_toml
from cnnum.templating.files.entry import About, Entry, FileFormat
from cnnum.templating.files.measured import read_measured
from cnnum.templating.files.proof import read_proof
from cnnum.templating.files.toml_couplings import Delay, delayed, gains, nonlinear
from cnnum.templating.files.toml_text import entry_to_toml
from cnnum.templating.files.toml_values import (
    check,
    matrix,
    names,
    number_or_text,
    per_layer,
    refuse_unknown,
    text,
)
from cnnum.templating.template import Template

_REQUIRED = ("name", "A")
_ABOUT: Mapping[str, Callable[[str, str, object], Any]] = {
    "input": text,
    "state": text,
    "tags": names,
    "experimental": text,
    "published_boundary": text,
}

# In the order in which the error for an unknown key lists them.
_READERS: Mapping[str, Callable[[str, str, object], Any]] = {
    "name": text,
    "A": matrix,
    "B": matrix,
    "z": per_layer,
    "tau": per_layer,
    "boundary": number_or_text,
    "input_boundary": number_or_text,
    "initial": number_or_text,
    "duration": number_or_text,
    "output": text,
    "description": text,
    "source": text,
    "nonlinear": nonlinear,
    "gain": gains,
    "delayed": delayed,
    "check": check,
}


def _read(content: str, file: str) -> Entry:
    try:
        table: dict[str, object] = parse_toml(content)
    except ValueError as error:
        raise TemplateError(f"'{file}' must be TOML, got an error: {error}.") from None
    aliases = names(file, "aliases", table.pop("aliases", []))
    found, proved = table.pop("measured", None), table.pop("proof", None)
    words = {key: read(file, key, table.pop(key)) for key, read in _ABOUT.items() if key in table}
    template = _template(file, table)
    try:
        measured = None if found is None else read_measured(file, "measured", found)
        proof = None if proved is None else read_proof(file, "proof", proved)
        return Entry(template, aliases, About(**words), measured, proof)
    except TemplateError as error:
        raise TemplateError(f"'{file}': {error}") from None


def _template(file: str, table: dict[str, object]) -> Template:
    refuse_unknown(file, table, (*_READERS, "aliases", *_ABOUT, "measured", "proof"))
    for key in _REQUIRED:
        if key not in table:
            raise TemplateError(f"'{file}': the key '{key}' is missing; every template needs it.")
    values = {key: _READERS[key](file, key, value) for key, value in table.items()}
    values["gains"] = values.pop("gain", ())
    delay: Delay | None = values.pop("delayed", None)
    try:
        template = Template(**values)
        return template if delay is None else Template(**values, delayed=delay.coupling(template))
    except (TemplateError, ArrayError, UnknownNameError) as error:
        raise TemplateError(f"'{file}': {error}") from None


TOML = FileFormat(".toml", _read, entry_to_toml)
"""A template as TOML text; reading it back gives the same template."""
