"""A template's transient to look at: a page, a strip of pictures, or a moving picture."""

from collections.abc import Callable, Mapping
from html import escape
from pathlib import Path
from typing import IO, Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.errors import name_error
from cnnum.pictures import as_pixels, pillow
from cnnum.runs.result import Result
from cnnum.safety.files import written
from cnnum.sharing import picture, style_rules
from cnnum.templating.template import Template

TIMES = 13
"""Times that are shown unless asked for otherwise, the start and the end among them."""

MILLISECONDS = 250
"""Of each picture of a moving one."""

_STYLE = """
:root { color-scheme: light dark; --paper: #fcfcfa; --ink: #16181d; --soft: #5b6270; }
@media (prefers-color-scheme: dark) { :root { --paper: #14161a; --ink: #e8eaee; --soft: #9aa1ad; } }
body { margin: 0 auto; max-width: 76rem; padding: 1.5rem 1rem; background: var(--paper);
       color: var(--ink); font: 15px/1.45 system-ui, sans-serif; }
figcaption, p { color: var(--soft); } p { max-width: 44rem; }
.run { display: grid; grid-template-columns: repeat(auto-fill, minmax(9.5rem, 1fr)); gap: 0.8rem; }
.run figure { margin: 0 !important; } .run svg { width: 100%; height: auto; }
"""


def default_picture(side: int = 16) -> Floats:
    """Return a picture to try templates on: a ring with a hole, a bar and a dot."""
    made = -np.ones((side, side))
    quarter = side // 4
    made[quarter : 3 * quarter, quarter : 3 * quarter] = 1.0
    made[side // 2 - 1 : side // 2 + 1, side // 2 - 1 : side // 2 + 1] = -1.0
    made[1, 1:-1] = 1.0
    made[-3, 2] = 1.0
    return made


def transient_of(
    engine: Engine, template: Template, shown: Floats, times: int = TIMES
) -> tuple[Floats, Result]:
    """Return times and a template's results on a picture until then.

    The picture is every input of the template; where it has none, the initial state.

    Parameters
    ----------
    engine : Engine
    template : Template
    shown : (rows, cols) float
    times : int
        How many, evenly from 0 to the template's duration, or to where it settles.
    """
    maps: dict[str, Any] = {"input": _stacked(shown, template.inputs)} if template.inputs else {}
    if not template.inputs:
        maps["state"] = _stacked(shown, template.layers)
    if template.duration == "settle":
        end = max(float(np.max(engine.run(template, **maps).time)), 1.0)
    else:
        end = template.duration
    if template.output.discrete:
        at = np.unique(np.rint(np.linspace(0.0, end, times)))
    else:
        at = np.linspace(0.0, end, times)
    return at, engine.run(template, **maps, at=at)


def _stacked(shown: Floats, count: int) -> Floats:
    return shown if count == 1 else np.broadcast_to(shown, (count, *shown.shape)).copy()


def write_transient(
    path: Path, template: Template, times: Floats, result: Result, *, force: bool = False
) -> None:
    """Write the transient: .html with states, .png with outputs side by side, .gif moving.

    Raises
    ------
    UnknownNameError, ReportError
        If the suffix is another one; if there is such a file, or it cannot be written.
    MissingExtraError
        If Pillow is not installed, for .png and .gif.
    """
    suffix = path.suffix.lower()
    if suffix not in WRITERS:
        raise name_error("kind of picture", path.suffix or path.name, WRITERS)
    with written(path, force=force) as file:
        WRITERS[suffix](file, template, times, result)


def _layers(values: Floats, template: Template) -> Floats:
    """Return (times, rows, layers · cols): layers side by side."""
    if template.layers == 1:
        return values
    return np.concatenate(list(np.moveaxis(values, 1, 0)), axis=2)


def _write_page(file: IO[bytes], template: Template, times: Floats, result: Result) -> None:
    states = _layers(result.state, template)
    top = float(np.abs(states).max())
    shown = "".join(
        picture(f"τ = {time:.4g}", state, top, styled=True)
        for time, state in zip(times, states, strict=True)
    )
    about = escape(" ".join(template.description.split()))
    name = escape(template.name)
    text = (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        '<meta name="generator" content="cnnum">'
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{name}</title><style>{_STYLE}{style_rules()}</style></head><body><h1>{name}</h1><p>{about}</p>"
        f"<p>The state at {len(times)} times, in time constants: blue above 0, orange below, to "
        f"±{top:.3g}. Method: {escape(result.method)}; estimated error at the end "
        f"{float(np.max(result.error[-1])):.2g}.</p><div class='run'>{shown}</div></body></html>\n"
    )
    file.write(text.encode("utf-8"))


def _frames(template: Template, result: Result) -> list[Any]:
    """Return the outputs as images, enlarged to a size that is easy to see."""
    pixels = as_pixels(_layers(result.output, template))
    scale = max(1, 128 // max(pixels.shape[1:]))
    image = _pillow()
    return [image.fromarray(p.repeat(scale, axis=0).repeat(scale, axis=1)) for p in pixels]


def _write_strip(file: IO[bytes], template: Template, times: Floats, result: Result) -> None:
    frames = _frames(template, result)
    width, height = frames[0].size
    across = min(len(frames), 7)
    gap = 6
    down = -(-len(frames) // across)
    size = (across * (width + gap) - gap, down * (height + gap) - gap)
    sheet = _pillow().new("L", size, 160)
    for n, frame in enumerate(frames):
        sheet.paste(frame, ((n % across) * (width + gap), (n // across) * (height + gap)))
    sheet.save(file, "PNG")


def _write_moving(file: IO[bytes], template: Template, times: Floats, result: Result) -> None:
    first, *rest = _frames(template, result)
    first.save(file, "GIF", save_all=True, append_images=rest, duration=MILLISECONDS, loop=0)


def _pillow() -> Any:
    return pillow("pictures of a transient", "or write a .html page, which needs no library")


WRITERS: Mapping[str, Callable[[IO[bytes], Template, Floats, Result], None]] = {
    ".html": _write_page,
    ".png": _write_strip,
    ".gif": _write_moving,
}
"""By the suffix of the file."""
