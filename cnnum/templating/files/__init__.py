"""Template files: read and written by suffix, one module per format."""

import re
from collections.abc import Iterable
from os import PathLike
from pathlib import Path

from cnnum.errors import TemplateError, TemplateFileError, say_once, unreadable
from cnnum.safety.files import write_whole
from cnnum.safety.reading import LARGEST, read_bytes, read_text
from cnnum.safety.values import as_path
from cnnum.templating.files import matcnn_format, tem_format
from cnnum.templating.files.cnnsim_format import CNNSIM
from cnnum.templating.files.entry import Entry, FileFormat, Measured, measured_toml
from cnnum.templating.files.matcnn_format import MATCNN
from cnnum.templating.files.tem_format import TEM
from cnnum.templating.files.toml_format import TOML
from cnnum.templating.files.unsaid import comments, unsaid, with_comments
from cnnum.templating.template import Template

_FORMATS: dict[str, FileFormat] = {
    file_format.suffix: file_format for file_format in (TOML, TEM, MATCNN, CNNSIM)
}
_SEVERAL = {TEM.suffix: tem_format.read_all, MATCNN.suffix: matcnn_format.read_all}

__all__ = [
    "Entry",
    "guessed",
    "left_unsaid",
    "load_entries",
    "load_entry",
    "load_template",
    "load_templates",
    "save_entry",
    "save_template",
    "write_measured",
]


def load_template(path: str | PathLike[str], *, strict: bool = False) -> Template:
    """Load a template from a file whose suffix gives the format.

    Whatever a file of another program leaves open is guessed, and each guess is logged by the
    logger "cnnum".

    Parameters
    ----------
    path : path
    strict : bool
        Whether to raise an error instead of guessing.

    Raises
    ------
    TemplateFileError
        If the file cannot be read.
    TemplateError
        If the suffix is unknown, or the content is not a template; the message names the file and
        the key.
    """
    return load_entry(path, strict=strict).template


def load_entry(path: str | PathLike[str], *, strict: bool = False) -> Entry:
    """Return a template together with the other names it goes by, as `load_template`.

    Raises
    ------
    TemplateFileError, TemplateError
        As `load_template`.
    """
    source = as_path(path, TemplateFileError)
    form, content = _format(source), _content(source)
    entry = _read(form, content, str(source))
    for sentence in guessed((entry,), strict=strict):
        say_once(sentence)
    return entry


def guessed(entries: Iterable[Entry], *, strict: bool = False) -> tuple[str, ...]:
    """Return what the readers of files guessed, a sentence each; what a format never says is none.

    Raises
    ------
    TemplateError
        If `strict` and there is a guess.
    """
    result = tuple(
        dict.fromkeys(g.sentence for entry in entries for g in entry.guesses if not g.always)
    )
    if result and strict:
        first, *others = result
        rest = f" There are {len(others)} more." if others else ""
        raise TemplateError(
            f"{first}{rest} A strict reading refuses this: correct the file, or read it "
            "without 'strict'."
        )
    return result


def load_entries(path: str | PathLike[str]) -> tuple[Entry, ...]:
    """Return every template of a file, with the words about it and what was guessed.

    Raises
    ------
    TemplateFileError, TemplateError
        As `load_template`.
    """
    source = Path(path)
    form = _format(source)
    if form.suffix not in _SEVERAL:
        return (load_entry(source),)
    content = _content(source)
    result = _SEVERAL[form.suffix](content, str(source))
    return (with_comments(result[0], content, str(source)),) if len(result) == 1 else result


def load_templates(path: str | PathLike[str]) -> tuple[Template, ...]:
    """Return every template of a file: MatCNN's library, or the parts of a time-varying `.tem`.

    Raises
    ------
    TemplateFileError, TemplateError
        As `load_template`.
    """
    entries = load_entries(path)
    for sentence in guessed(entries):
        say_once(sentence)
    return tuple(entry.template for entry in entries)


def _content(source: Path) -> str:
    """Return the text of a file, its lines ended by a line feed as a comment's value needs it.

    Old files, which end in ^Z, are in a code page of Windows.
    """
    return re.sub(r"\r\n?", "\n", _decoded(source))


def _decoded(source: Path) -> str:
    try:
        return read_text(source, most=LARGEST)
    except UnicodeDecodeError as error:
        if source.suffix.lower() == TOML.suffix:
            raise TemplateError(f"'{source}' must be UTF-8 text, got {error.reason}.") from None
        return read_bytes(source, most=LARGEST).decode("cp1250", errors="replace")
    except OSError as error:
        what = f"The template file '{source}'"
        raise unreadable(TemplateFileError, what, error, "; check the path") from None


def save_template(
    template: Template | str,
    path: str | PathLike[str],
    *,
    aliases: Iterable[str] = (),
    force: bool = False,
) -> None:
    """Write a template to a file, completely or not at all.

    Parameters
    ----------
    template : Template or str
        A template, or the name of one of the library.
    path : path
        Its suffix gives the format.
    aliases : iterable of str
        Other names by which the library finds the template.
    force : bool
        Whether to replace an existing file.

    Raises
    ------
    TemplateFileError
        If the file exists already, or cannot be written.
    TemplateError
        If the suffix is unknown, or a text of the template cannot be encoded as UTF-8.
    """
    from cnnum.templating.library import as_template  # it reads files by this module

    save_entry(Entry(as_template(template), tuple(aliases)), path, force=force)


def save_entry(entry: Entry, path: str | PathLike[str], *, force: bool = False) -> None:
    """Write a template with all that a file says about it, whole or not at all.

    Raises
    ------
    TemplateFileError, TemplateError
        As `save_template`.
    NotSupportedError
        If the format cannot hold a part of the template.
    """
    target = as_path(path, TemplateFileError)
    form = _format(target)
    text = form.write(entry)
    _write(target, text + comments(left_unsaid(entry, path)), force=force)


def left_unsaid(entry: Entry, path: str | PathLike[str]) -> dict[str, object]:
    """Return what the format of a file has no words for: `save_entry` writes it as comments.

    Returns
    -------
    dict of str to object
        Keyed as in the TOML format, which can express everything.
    """
    form = _format(as_path(path, TemplateFileError))
    return {} if form is TOML else unsaid(entry, form, form.write(entry))


def _read(form: FileFormat, content: str, file: str) -> Entry:
    entry = form.read(content, file)
    return entry if form is TOML else with_comments(entry, content, file)


def write_measured(path: str | PathLike[str], measured: Measured) -> None:
    """Write the table [measured] at the end of a TOML template, in the place of an older one.

    Nothing else of the file changes, comments included.

    Raises
    ------
    TemplateFileError
        If the file cannot be read or written.
    TemplateError
        If it would be no template afterwards.
    """
    target = Path(path)
    load_entry(target)
    kept = _content(target).partition("\n[measured]\n")[0]
    content = kept.rstrip("\n") + "\n\n" + measured_toml(measured)
    TOML.read(content, str(target))
    _write(target, content, force=True)


def _write(target: Path, text: str, *, force: bool) -> None:
    try:
        content = text.encode("utf-8")
    except UnicodeEncodeError as error:
        raise TemplateError(
            f"'{target}' cannot be written as UTF-8 text: {error.reason}; "
            "remove that character from the name, the description or the source."
        ) from None
    write_whole(target, content, error=TemplateFileError, force=force)


def _format(path: Path) -> FileFormat:
    suffix = path.suffix.lower() or CNNSIM.suffix
    if suffix not in _FORMATS:
        known = ", ".join(f"'{item}'" for item in _FORMATS)
        raise TemplateError(
            f"'{path}' must be a template file with a known suffix ({known}), got '{suffix}'."
        )
    return _FORMATS[suffix]
