"""The template library, which finds templates by name among the installed template files.

A library file has the name of its template in lower case, so that looking up a name reads only one
file. Only an alias or an unknown name makes the library read all files.
"""

import difflib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import cast

from cnnum.errors import TemplateError, UnknownNameError, name_error
from cnnum.templating.files import Entry, load_entry
from cnnum.templating.template import Template

_SUFFIX = ".toml"


def get_template(name: str) -> Template:
    """Return the library's template of that name or alias, regardless of case.

    Raises
    ------
    UnknownNameError
        If the library has no template of that name; the message suggests similar names.
    """
    return _load(template_path(name)).template


def get_entry(name: str) -> Entry:
    """Return the library's template with its description and its measured figures.

    Raises
    ------
    UnknownNameError
        If there is none; the message suggests similar names.
    """
    return _load(template_path(name))


def template_names() -> tuple[str, ...]:
    """Return the names of all templates of the library, sorted without regard to case."""
    return tuple(sorted((_load(path).template.name for path in _files().values()), key=str.lower))


def template_path(name: str) -> Path:
    """Return the file that holds the template of that name or alias.

    Raises
    ------
    UnknownNameError
        If there is none; the message suggests similar names.
    """
    if not isinstance(cast(object, name), str):
        raise name_error("template", name, template_names())
    key = name.lower()
    path = _files().get(key) or _aliases().get(key)
    if path is None:
        raise _unknown(name)
    return path


def as_template(template: object) -> Template:
    """Return a template unchanged, or the library's template of that name.

    Raises
    ------
    TemplateError
        If it is neither a template nor a name.
    UnknownNameError
        If there is none of that name.
    """
    if isinstance(template, Template):
        return template
    if not isinstance(template, str):
        raise TemplateError(
            f"Expected a template or the name of one, got {type(template).__name__}; programs "
            "are run with engine.compile."
        )
    return get_template(template)


@cache
def _files() -> Mapping[str, Path]:
    """Return the template files by their stem, which is the template's name in lower case."""
    return _unique((path.stem.lower(), path) for path in _walk())


@cache
def _aliases() -> Mapping[str, Path]:
    return _unique(
        (alias.lower(), path) for path in _files().values() for alias in _load(path).aliases
    )


@cache
def _load(path: Path) -> Entry:
    return load_entry(path)


def _walk() -> Iterator[Path]:
    with resources.as_file(resources.files("cnnum.templates")) as root:
        yield from sorted(root.glob(f"*/*{_SUFFIX}"), key=str)  # paths compare part by part


def _unique(pairs: Iterator[tuple[str, Path]]) -> Mapping[str, Path]:
    result: dict[str, Path] = {}
    for name, path in pairs:
        if name in result and result[name] != path:
            raise TemplateError(
                f"The template library has '{name}' twice, in '{result[name]}' and '{path}'; "
                "rename one of them."
            )
        result[name] = path
    return MappingProxyType(result)


def _unknown(name: str) -> UnknownNameError:
    known = {item.lower(): item for item in template_names()}
    known |= {alias: alias for alias in _aliases() if alias not in known}
    near = difflib.get_close_matches(name.lower(), known, n=5, cutoff=0.5)
    hint = (
        f"did you mean {', '.join(repr(known[item]) for item in near)}?"
        if near
        else "cnnum.template_names() lists all of them."
    )
    return UnknownNameError(
        f"Unknown template '{name}': expected one of the library's {len(_files())}; {hint}"
    )
