"""What a template file holds, and what a file format can do."""

from collections.abc import Callable
from dataclasses import dataclass

from cnnum.template import Template


@dataclass(frozen=True, slots=True)
class Entry:
    """A template and the other names it goes by."""

    template: Template
    aliases: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class FileFormat:
    """A file format of templates.

    Attributes
    ----------
    suffix : str
        In lower case, with its dot.
    read : callable
        (text, name of the file) to an entry; the name is for error messages only.
    write : callable
        An entry to text.
    """

    suffix: str
    read: Callable[[str, str], Entry]
    write: Callable[[Entry], str]
