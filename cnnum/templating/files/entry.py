"""The content of a template file, and the abilities of a file format."""

from collections.abc import Callable
from dataclasses import dataclass, field

from cnnum.errors import TemplateError
from cnnum.safety.names import checked_name
from cnnum.templating.files.measured import Measured
from cnnum.templating.files.proof import Proof
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True)
class About:
    """The words that a file has about its template; they change no run.

    Attributes
    ----------
    input, state : str
        The meaning of the input and of the initial state.
    tags : tuple of str
    experimental : str
        Why no check shows that the template does its job; empty where one does.
    published_boundary : str
        The boundary that the source names, where the library uses another.
    """

    input: str = ""
    state: str = ""
    tags: tuple[str, ...] = ()
    experimental: str = ""
    published_boundary: str = ""


@dataclass(frozen=True, slots=True)
class Entry:
    """A template, the other names it goes by, the words about it, its measured figures and proof.

    Attributes
    ----------
    measured : Measured or None
        Written by a command; None where nothing was measured yet.
    proof : Proof or None
        Proof of a template that a command designed.

    Raises
    ------
    TemplateError
        If an alias is not one line of plain signs.
    """

    template: Template
    aliases: tuple[str, ...] = ()
    about: About = field(default_factory=About)
    measured: Measured | None = None
    proof: Proof | None = None

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
