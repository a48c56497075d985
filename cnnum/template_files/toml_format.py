"""Templates as TOML: what the library is written in.

Keys: name, A, B, z, tau, boundary, input_boundary, initial, duration, output, description, source,
aliases, and the table [check] with the name of a closed form and its parameters. Matrices are
nested lists of rows, (k, k) or [to][from][row][col].
"""

import tomllib

from cnnum.errors import ArrayError, TemplateError, UnknownNameError
from cnnum.template import Template
from cnnum.template_files.entry import Entry, FileFormat
from cnnum.template_files.toml_text import entry_to_toml
from cnnum.template_files.toml_values import READERS, names

_REQUIRED = ("name", "A")


def _read(text: str, file: str) -> Entry:
    try:
        table: dict[str, object] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise TemplateError(f"'{file}' must be TOML, got an error: {error}.") from None
    except RecursionError:
        raise TemplateError(f"'{file}' must be TOML, got brackets nested too deep.") from None
    aliases = names(file, "aliases", table.pop("aliases", []))
    return Entry(_template(file, table), aliases)


def _template(file: str, table: dict[str, object]) -> Template:
    for key in table:
        if key not in READERS:
            raise TemplateError(
                f"'{file}': unknown key '{key}', expected one of "
                f"{', '.join([*READERS, 'aliases'])}."
            )
    for key in _REQUIRED:
        if key not in table:
            raise TemplateError(f"'{file}': the key '{key}' is missing; every template needs it.")
    values = {key: READERS[key](file, key, value) for key, value in table.items()}
    try:
        return Template(**values)
    except (TemplateError, ArrayError, UnknownNameError) as error:
        raise TemplateError(f"'{file}': {error}") from None


TOML = FileFormat(".toml", _read, entry_to_toml)
