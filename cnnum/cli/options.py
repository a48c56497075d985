"""Options that several commands share, and their values."""

import tomllib
from collections.abc import Callable, Iterable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

import click
from click.shell_completion import CompletionItem

from cnnum.safety.files import refuse_target
from cnnum.safety.names import shown
from cnnum.safety.reading import parse_toml

Function = TypeVar("Function", bound=Callable[..., Any])
Changes = dict[str, object]

json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON object per line."
)
"""Every command takes it."""


force_option = click.option(
    "--force", is_flag=True, is_eager=True, help="Replace an existing file."
)
"""Every command that writes files takes it; it is read before the names of the files."""


def to_write(ctx: click.Context, _: click.Parameter, out: Path | None) -> Path | None:
    """Return the file to write, refusing before the work one that could not be written.

    Raises
    ------
    ReportError
        If its folder is not there, it is no regular file, or it exists and is not to be replaced.
    """
    if out is not None:
        refuse_target(out, force=bool(ctx.params.get("force")))
    return out


def file_option(default: str, text: str) -> Callable[[Function], Function]:
    """Return the option `--out`: a file to write in a folder that is there."""
    return click.option(
        "--out",
        type=click.Path(path_type=Path, dir_okay=False),
        default=Path(default),
        callback=to_write,
        show_default=True,
        help=text,
    )


def target_option(name: str, metavar: str, text: str) -> Callable[[Function], Function]:
    """Return an option whose value is a file to write."""
    return click.option(
        name,
        type=click.Path(path_type=Path, dir_okay=False),
        metavar=metavar,
        callback=to_write,
        help=text,
    )


def completed(kind: str, *, files: bool = False) -> Callable[..., list[CompletionItem]]:
    """Return how the Tab key completes an argument: with names of a kind, or with files.

    Parameters
    ----------
    kind : str
        "template", "program" or "scene".
    files : bool
        Whether the argument may be a file, too.
    """

    def complete(_: click.Context, __: click.Parameter, begun: str) -> list[CompletionItem]:
        import cnnum  # the names are read when they are asked for

        named = getattr(cnnum, f"{kind}_names")()
        found = [CompletionItem(n) for n in named if n.lower().startswith(begun.lower())]
        return found or ([CompletionItem(begun, type="file")] if files else [])

    return complete


def setting_option(text: str) -> Callable[[Function], Function]:
    """Return the option `--set`, which may come again for more."""
    return click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help=text)


frames_option = click.option(
    "--frames", type=click.IntRange(min=1), help="Stop after this number of frames."
)
seconds_option = click.option(
    "--seconds",
    type=click.FloatRange(min=0, min_open=True),
    help="Stop after this number of seconds.",
)

page_option = click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.html",
    callback=to_write,
    help="Write a page with all tables and pictures.",
)


results_option = click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Write PNG, JSON and HTML into this folder.",
)


def together(*options: Callable[[Function], Function]) -> Callable[[Function], Function]:
    """Return the decorator that adds options in this order."""

    def add(function: Function) -> Function:
        for option in reversed(options):
            function = option(function)
        return function

    return add


engine_options = together(
    click.option("--engine", help="Engine to run on: opencl, numba or reference."),
    click.option("--device", help="Part of the device's name."),
    click.option("--precision", help="float32 or float64."),
)
"""They choose an engine."""

trust_option = click.option(
    "--trust",
    is_flag=True,
    help="Allow a driver or a program that the scene file names as 'module:name' to run.",
)
"""For commands that open scenes: such a driver is code."""

set_option = setting_option("Set a key of the scene, such as 'array.seed=3'; may be repeated.")


def scene_options(function: Function) -> Function:
    """Add the options that change a scene; the command takes them as `changes`."""

    @wraps(function)
    def command(
        settings: Iterable[str],
        engine: str | None,
        device: str | None,
        precision: str | None,
        **others: object,
    ) -> object:
        chosen = {"engine.name": engine, "engine.device": device, "engine.precision": precision}
        changes = assignments(settings) | {key: value for key, value in chosen.items() if value}
        return function(changes=changes, **others)

    return set_option(engine_options(cast(Function, command)))


def assignments(settings: Iterable[str], prefix: str = "") -> dict[str, object]:
    """Return the values of `--set` options, by dotted key.

    A value is read as TOML (number, string in quotes, true, list). Anything else is a string as it
    stands, so that paths and names need no quotes.

    Raises
    ------
    click.UsageError
        If one is not of the form key=value, or its value is a number or a list beyond all bounds.
    """
    found: dict[str, object] = {}
    for text in settings:
        key, equals, value = text.partition("=")
        key = key.strip()
        if not equals or not all(key.split(".")):
            raise click.UsageError(f"Expected KEY=VALUE, as in 'array.seed=3', got {shown(text)}.")
        found[prefix + key] = toml_value(value.strip())
    return found


def toml_value(text: str) -> object:
    """Return a value as TOML reads it, or the text itself where it is none.

    Raises
    ------
    click.UsageError
        If it is a number of more than 64 bits, or nested too deep.
    """
    try:
        table = parse_toml(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text
    except ValueError as error:
        raise click.UsageError(f"The value '{text:.40}…' cannot be used: {error}.") from None
    return table["value"] if set(table) == {"value"} else text
