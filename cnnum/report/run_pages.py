"""Pages of a run to look at: the transient of a template, and every operation of a program."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from cnnum import sharing
from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.errors import ReportError, name_error
from cnnum.graph.tracing import TraceStep, folds, function_of
from cnnum.pictures import FASTEST, FILMS, as_pixels, pillow, write_film
from cnnum.runs.result import Result
from cnnum.safety.files import write_whole, written
from cnnum.sharing import picture, style_rules
from cnnum.templating.numbers import matrices
from cnnum.templating.template import Template

Writer = Callable[[IO[bytes], Template, Floats, Result], None]

TIMES = 13
"""Times that are shown unless asked for otherwise, the start and the end among them."""

SLOWEST, LASTS = 4.0, 4.0
"""Pictures a second of a film, at least, and seconds that one of more pictures lasts."""

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

    Raises
    ------
    ReportError
        If the duration is 0.
    """
    if template.duration == 0:
        raise ReportError(
            f"Template '{template.name}' has the duration 0, so there is no transient to show."
        )
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
    """Write the transient: .html with states, .png with outputs side by side, .gif, .mp4 and .webm
    as a film, and .svg for a paper, with the template's matrices above outputs at up to seven
    times.

    Raises
    ------
    UnknownNameError, ReportError
        If the suffix is another one; if there is such a file, or it cannot be written.
    MissingExtraError
        If Pillow is not installed, for .png and .gif, or PyAV, for .mp4 and .webm.
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
        picture(template.timed(time, 4), state, top, styled=True)
        for time, state in zip(times, states, strict=True)
    )
    summary = escape(" ".join(template.description.split()))
    name = escape(template.name)
    text = (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        '<meta name="generator" content="cnnum">'
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{name}</title><style>{_STYLE}{style_rules()}</style></head><body><h1>{name}</h1><p>{summary}</p>"
        f"<p>The state at {len(times)} times: blue above 0, orange below, to "
        f"±{top:.3g}. Method: {escape(result.method)}; estimated error at the end "
        f"{float(np.max(result.error[-1])):.2g}.</p><div class='run'>{shown}</div></body></html>\n"
    )
    file.write(text.encode("utf-8"))


def _frames(template: Template, result: Result) -> list[NDArray[np.uint8]]:
    """Return the outputs as pixels, enlarged to a size that is easy to see."""
    pixels = as_pixels(_layers(result.output, template))
    scale = max(1, 128 // max(pixels.shape[1:]))
    return [page.repeat(scale, axis=0).repeat(scale, axis=1) for page in pixels]


def _write_strip(file: IO[bytes], template: Template, times: Floats, result: Result) -> None:
    image, frames = _pillow(), _frames(template, result)
    height, width = frames[0].shape
    across = min(len(frames), 7)
    gap = 6
    down = -(-len(frames) // across)
    size = (across * (width + gap) - gap, down * (height + gap) - gap)
    sheet = image.new("L", size, 160)
    for n, frame in enumerate(frames):
        place = ((n % across) * (width + gap), (n // across) * (height + gap))
        sheet.paste(image.fromarray(frame), place)
    sheet.save(file, "PNG")


def _film(suffix: str) -> Writer:
    def write(file: IO[bytes], template: Template, times: Floats, result: Result) -> None:
        rate = min(max(len(times) / LASTS, SLOWEST), FASTEST)
        write_film(file, suffix, _frames(template, result), rate)

    return write


STRIP = 7
"""Times of a strip for a paper, at most."""


def _write_figure(file: IO[bytes], template: Template, times: Floats, result: Result) -> None:
    """Write matrices as stencils above outputs in time, as shapes and text, 24 units per cell."""
    cell, gap, x = 24.0, 16.0, 0.0
    parts, tallest = list[str](), 0
    for label, kernel in [*matrices(template), ("z", template.z)]:
        grid = np.atleast_2d(kernel)
        rows, cols = grid.shape
        parts.append(f"<text x='{x:g}' y='14' class='name'>{escape(label)}</text>")
        for (row, col), value in np.ndenumerate(grid):
            left, top = x + 1.75 * cell * col, 22 + cell * row
            parts.append(
                f"<rect x='{left:g}' y='{top:g}' width='{1.75 * cell:g}' height='{cell:g}' "
                f"class='box'/><text x='{left + 0.875 * cell:g}' y='{top + 16:g}' "
                f"class='number'>{value:.4g}</text>"
            )
        x, tallest = x + 1.75 * cell * cols + gap, max(tallest, rows)
    outputs = _layers(result.output, template)
    shown = np.unique(np.linspace(0, len(times) - 1, min(STRIP, len(times))).round().astype(int))
    height, width = outputs.shape[1:]
    size, top, left = 112.0 / max(height, width), 44.0 + cell * tallest, 0.0
    for at in shown.tolist():
        parts += _cells(outputs[at], left, top, size)
        label = escape(f"t = {template.timed(float(times[at]), 3)}")
        parts.append(f"<text x='{left:g}' y='{top + size * height + 16:g}'>{label}</text>")
        left += size * width + gap
    wide, tall = max(x, left) - gap + 2, top + size * height + 24
    text = (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='-1 0 {wide:g} {tall:g}' "
        f"width='{wide:g}' height='{tall:g}'><title>{escape(template.name)}</title><style>"
        "text { font: 12px sans-serif; } .name { font-weight: bold; } .number { text-anchor: "
        "middle; } .box { fill: none; stroke: #888; }</style>" + "".join(parts) + "</svg>\n"
    )
    file.write(text.encode("utf-8"))


def _cells(output: Floats, left: float, top: float, size: float) -> list[str]:
    """Return the cells of a map as shapes, equal ones of a row in one; +1 is black."""
    grays, shapes = as_pixels(output), list[str]()
    for row, line in enumerate(grays.tolist()):
        starts = [0, *(np.flatnonzero(np.diff(line)) + 1).tolist(), len(line)]
        for first, last in itertools.pairwise(starts):
            gray = line[first]
            shapes.append(
                f"<rect x='{left + size * first:g}' y='{top + size * row:g}' "
                f"width='{size * (last - first):g}' height='{size:g}' "
                f"fill='#{gray:02x}{gray:02x}{gray:02x}'/>"
            )
    height, width = (size * count for count in output.shape)
    return [
        *shapes,
        f"<rect x='{left:g}' y='{top:g}' width='{width:g}' height='{height:g}' class='box'/>",
    ]


def _pillow() -> Any:
    return pillow("pictures of a transient", "or write a .html page, which needs no library")


WRITERS: Mapping[str, Writer] = {
    ".html": _write_page,
    ".png": _write_strip,
    **{suffix: _film(suffix) for suffix in FILMS},
    ".svg": _write_figure,
}
"""Writers by file suffix."""


_SIDE = 132
"""Width of a picture, px."""


def write_trace_page(
    path: Path, title: str, steps: Sequence[TraceStep], *, force: bool = False
) -> None:
    """Write a self-contained page with every operation's result.

    Steps are grouped by the function of the program that requested them. Chains of local arithmetic
    are folded into their last step.

    Parameters
    ----------
    path : Path
    title : str
    steps : sequence of TraceStep
        Results for one frame: maps (rows, cols), stacks (maps, rows, cols) or numbers.
    force : bool
        Whether a file that is there, and is no page of cnnum, is replaced.

    Raises
    ------
    ReportError
        If another file is there, or it cannot be written.
    """
    text = (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        '<meta name="generator" content="cnnum">'
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{_file('trace.css')}{sharing.style_rules()}</style>"
        f"</head><body><h1>{escape(title)}: {len(steps)} operations</h1>"
        "<p>By the function of the program that asks for them, in the order in which they run. "
        "Each picture has its own scale, whose end is written under it. Framed results are "
        "outputs of the program. Local arithmetic that only one step reads is folded into it.</p>"
        f"{_legend()}<div class='find'><input id='search' type='search' placeholder='Search: "
        "memory, template, a function, an output' aria-label='Search the steps'>"
        f"<span id='count'></span></div>{_functions(steps)}"
        f"<script>{_file('trace.js')}</script></body></html>\n"
    )
    write_whole(path, text, force=force)


def _functions(steps: Sequence[TraceStep]) -> str:
    """Return one section per function, in the order in which they first run."""
    into = folds(steps)
    inside: dict[int, list[TraceStep]] = {}
    parts: dict[str, list[TraceStep]] = {}
    for step in steps:
        if step.number in into:
            inside.setdefault(into[step.number], []).append(step)
        else:
            parts.setdefault(function_of(step), []).append(step)
    return "".join(_section(name, part, inside) for name, part in parts.items())


def _section(
    name: str, steps: Sequence[TraceStep], inside: Mapping[int, Sequence[TraceStep]]
) -> str:
    function, _, module = name.partition(" ")
    cards = "\n".join(_card(step, inside.get(step.number, ())) for step in steps)
    count = len(steps) + sum(len(inside.get(step.number, ())) for step in steps)
    word = "step" if count == 1 else "steps"
    return (
        f"<section><details open><summary>{escape(function or 'the program itself')} "
        f"<small>{escape(module)} · {count} {word}</small></summary><ol>{cards}</ol></details>"
        "</section>"
    )


def _card(step: TraceStep, inside: Sequence[TraceStep] = ()) -> str:
    line = step.origin.rpartition(":")[2]
    links = ", ".join(f"<a href='#step{n}'>{n}</a>" for n in step.arguments)
    value = _number(float(step.value)) if step.value.ndim == 0 else _maps(step)
    said = [f"gives {escape(', '.join(step.outputs))}"] if step.outputs else []
    said += [f"kept as memory {escape(', '.join(step.stores))}"] if step.stores else []
    folded = "".join(map(_card, inside))
    words = " ".join((step.operation, *step.outputs, *step.stores, step.origin, f"#{step.number}"))
    return (
        f"<li{' class=output' if step.outputs else ''} id='step{step.number}' "
        f"data-words='{escape(words.lower())}'>"
        f"<b>{step.number} · {escape(step.operation)}</b>"
        f"<small>line {escape(line)}{f', reads {links}' if links else ''}</small>{value}"
        + "".join(f"<small>{sentence}</small>" for sentence in said)
        + (
            f"<details><summary>{_folded(inside)}</summary><ol>{folded}</ol></details>"
            * bool(folded)
        )
        + "</li>"
    )


def _folded(inside: Sequence[TraceStep]) -> str:
    return f"{len(inside)} step{'s' * (len(inside) > 1)} folded"


def _number(value: float) -> str:
    return f"<div class='number'>{value:.5g}</div>"


def _legend() -> str:
    """Return the scale of all pictures."""
    count = sharing.STEPS + 1
    bars = "".join(f"<rect class='k{n}' x='{n}' width='1.05' height='1'/>" for n in range(count))
    return (
        f"<div class='scale'>−end<svg viewBox='0 0 {count} 1' preserveAspectRatio='none' "
        f"role='img' aria-label='orange below 0, blue above'>{bars}</svg>+end "
        "(orange below 0, blue above)</div>"
    )


def _maps(step: TraceStep) -> str:
    """Return the picture of a map, or of a stack's maps in reading order, on one scale."""
    values = step.value.reshape(-1, *step.value.shape[-2:])
    count, rows, cols = values.shape
    top = float(np.abs(values).max())
    across = math.ceil(math.sqrt(count))
    # a gap of a cell between the maps of a stack
    width, height = across * (cols + 1) - 1, -(-count // across) * (rows + 1) - 1
    cells = "".join(
        _map(value, top, (k // across) * (rows + 1), (k % across) * (cols + 1))
        for k, value in enumerate(values)
    )
    note = f"±{top:.3g}" if count == 1 else f"{count} maps, ±{top:.3g}"
    return (
        f"<svg viewBox='0 0 {width} {height}' width='{_SIDE}' role='img' "
        f"aria-label='{escape(step.operation)}'>{cells}</svg><small>{note}</small>"
    )


def _map(values: Floats, top: float, below: int, right: int) -> str:
    """Return a map's cells, a run of equal ones in a row as one rectangle."""
    parts: list[str] = []
    for r, row in enumerate(values):
        kinds = [sharing.step(float(value), top) for value in row]
        starts = [c for c in range(len(kinds)) if c == 0 or kinds[c] != kinds[c - 1]]
        for start, end in zip(starts, [*starts[1:], len(kinds)], strict=True):
            parts.append(
                f"<rect class=k{kinds[start]} x={right + start} y={below + r} "
                f"width={end - start}.03 height=1.03 />"
            )
    return "".join(parts)


def _file(name: str) -> str:
    return resources.files("cnnum.report").joinpath(name).read_text(encoding="utf-8")
