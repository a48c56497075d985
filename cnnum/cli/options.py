"""Options that several commands share, their values, and the array that a command reads."""

import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click
from click.shell_completion import CompletionItem

from cnnum.errors import UnknownNameError
from cnnum.safety.files import refuse_target
from cnnum.safety.reading import names_something, parse_toml
from cnnum.safety.values import shown

if TYPE_CHECKING:
    from cnnum.drivers.driver import Driver


Given = TypeVar("Given")
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


def _to_draw(ctx: click.Context, parameter: click.Parameter, out: Path | None) -> Path | None:
    if out is not None:
        from cnnum.report.plots import refuse_unknown_kind

        refuse_unknown_kind(out)
    return to_write(ctx, parameter, out)


def picture_option(name: str, text: str) -> Callable[[Function], Function]:
    """Return an option whose value is a picture to draw, refused before the work like a file."""
    return click.option(
        name,
        type=click.Path(path_type=Path, dir_okay=False),
        metavar="FILE.svg|png|pdf",
        callback=_to_draw,
        help=text,
    )


def page_options(port: int) -> Callable[[Function], Function]:
    """Return the options `--host`, `--port` and `--token` of a page in a browser."""
    return together(
        click.option(
            "--host",
            default="127.0.0.1",
            help="Address to listen at; this machine only by default.",
        ),
        click.option(
            "--port",
            type=click.IntRange(0, 65_535),
            default=port,
            help="Port to listen at; 0 takes any free one.",
        ),
        click.option(
            "--token", default="", help="Token that the address of the page must contain."
        ),
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
        result = [CompletionItem(n) for n in named if n.lower().startswith(begun.lower())]
        return result or ([CompletionItem(begun, type="file")] if files else [])

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
    result: dict[str, object] = {}
    for text in settings:
        key, equals, value = text.partition("=")
        key = key.strip()
        if not equals or not all(key.split(".")):
            raise click.UsageError(f"Expected KEY=VALUE, as in 'array.seed=3', got {shown(text)}.")
        result[prefix + key] = toml_value(value.strip())
    return result


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


def open_source(source: str, settings: Mapping[str, object], *, trust: bool = False) -> "Driver":
    """Open a driver by its name, or the array of a scene.

    Parameters
    ----------
    source : str
        Name of a driver or a scene, or a scene's TOML file.
    settings : mapping of str to object
        Options of the driver, over those of the scene.
    trust : bool
        Whether a driver that a scene file names as "module:Options" may be imported.

    Raises
    ------
    UnknownNameError
        If it is none of these.
    CnnumError
        From opening the source.
    """
    from cnnum.drivers.registry import driver_names, is_driver, open_driver
    from cnnum.scenes.scene_file import read_scene, scene_names

    if is_driver(source):
        return open_driver(source, settings)
    if source not in scene_names() and not names_something(Path(source)):
        raise UnknownNameError(
            f"There is no array {shown(source)}: expected one of the drivers "
            f"{', '.join(driver_names())}, one of the scenes {', '.join(scene_names())}, or a "
            "scene's TOML file."
        )
    changes = {f"array.{key}": value for key, value in settings.items()}
    spec = read_scene(source, changes=changes, trust=trust)
    return open_driver(spec.driver, spec.driver_options, base=spec.base)


def is_hand_file(source: str) -> bool:
    """Return whether a source is the file of a hand, not a driver or a scene."""
    from cnnum.drivers.registry import is_driver
    from cnnum.scenes.scene_file import is_hand, scene_names

    named = is_driver(source) or source in scene_names()
    return not named and names_something(Path(source)) and is_hand(source)


def scene_text(source: str) -> str:
    """Return the text of a scene; empty where the source is a driver, or cannot be read."""
    from cnnum.drivers.registry import is_driver

    if is_driver(source):
        return ""
    from cnnum.scenes.scene_file import text_of

    return text_of(source)


def limited(given: Iterable[Given], seconds: float | None, frames: int | None) -> Iterator[Given]:
    """Yield frames, or steps of several arrays, up to a count or a time by the host's clock."""
    begin = time.monotonic()
    for count, frame in enumerate(given, start=1):
        yield frame
        late = seconds is not None and time.monotonic() - begin >= seconds
        if late or (frames is not None and count >= frames):
            return


RAW = ("count", "V")
"""Units of arrays that nothing is known of: no scene fits all of them."""


def usual_scene(
    file: Path, array: Mapping[str, object], given: Mapping[str, object], usual: str
) -> str:
    """Return the usual scene, which fits calibrated recordings; counts fit none unasked.

    Raises
    ------
    click.UsageError
        If the recording has raw values.
    """
    from cnnum.drivers.registry import open_driver

    options = {key.removeprefix("array."): v for key, v in given.items() if key[:6] == "array."}
    options = {key: value for key, value in ({**array, **options}).items() if key != "driver"}
    with open_driver(str(array["driver"]), options) as driver:
        raw = driver.unit in RAW and getattr(driver, "calibration", None) is None
        unit = driver.unit
    if raw:
        raise click.UsageError(
            f"'{file}' contains values in '{unit}', whose physical scale is unknown: choose a "
            "scene for them, as in '--scene uskin_grasp', or write a scene file of your own."
        )
    return usual
