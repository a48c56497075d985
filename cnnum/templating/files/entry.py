"""What a template file holds, and what a file format can do."""

from collections.abc import Callable
from dataclasses import dataclass

from cnnum.errors import TemplateError
from cnnum.safety.names import checked_name
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True)
class Entry:
    """A template and the other names it goes by.

    Raises
    ------
    TemplateError
        If an alias is not one line of plain signs.
    """

    template: Template
    aliases: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for alias in self.aliases:
            checked_name("an alias of a template", alias, TemplateError)


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
