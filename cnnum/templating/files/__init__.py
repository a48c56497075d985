"""Template files: read and written by suffix, one module a format."""

from collections.abc import Iterable
from os import PathLike
from pathlib import Path

from cnnum.errors import TemplateError, TemplateFileError
from cnnum.safety.reading import read_text
from cnnum.safety.toml_reading import LARGEST
from cnnum.templating.files.entry import Entry, FileFormat
from cnnum.templating.files.measured import Measured, measured_toml
from cnnum.templating.files.toml_format import TOML
from cnnum.templating.files.writing import write_text
from cnnum.templating.template import Template

_FORMATS: dict[str, FileFormat] = {TOML.suffix: TOML}

__all__ = ["Entry", "load_entry", "load_template", "save_template", "write_measured"]


def load_template(path: str | PathLike[str]) -> Template:
    """Return the template that a file describes; its suffix tells the format.

    Raises
    ------
    TemplateFileError
        If the file cannot be read.
    TemplateError
        If the suffix is unknown, or the content is not a template; names the file and the key.
    """
    return load_entry(path).template


def load_entry(path: str | PathLike[str]) -> Entry:
    """Return a template together with the other names it goes by.

    Raises
    ------
    TemplateFileError, TemplateError
        As `load_template`.
    """
    source = Path(path)
    form = _format(source)
    try:
        text = read_text(source, most=LARGEST)
    except UnicodeDecodeError as error:
        raise TemplateError(f"'{source}' must be UTF-8 text, got {error.reason}.") from None
    except OSError as error:
        raise TemplateFileError(
            f"The template file '{source}' cannot be read: {error.strerror}; check the path."
        ) from None
    return form.read(text, str(source))


def save_template(
    template: Template, path: str | PathLike[str], *, aliases: Iterable[str] = ()
) -> None:
    """Write a template to a file, whole or not at all.

    Parameters
    ----------
    template : Template
    path : path
        Its suffix tells the format; an existing file is replaced.
    aliases : iterable of str
        Other names that the library finds it by.

    Raises
    ------
    TemplateFileError
        If the file cannot be written.
    TemplateError
        If the suffix is unknown.
    """
    target = Path(path)
    form = _format(target)
    write_text(target, form.write(Entry(template, tuple(aliases))))


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
    kept = target.read_text(encoding="utf-8").partition("\n[measured]\n")[0]
    content = kept.rstrip("\n") + "\n\n" + measured_toml(measured)
    TOML.read(content, str(target))
    write_text(target, content)


def _format(path: Path) -> FileFormat:
    suffix = path.suffix.lower()
    if suffix not in _FORMATS:
        known = ", ".join(f"'{item}'" for item in _FORMATS)
        raise TemplateError(
            f"'{path}' must be a template file with a known suffix ({known}), got '{suffix}'."
        )
    return _FORMATS[suffix]
