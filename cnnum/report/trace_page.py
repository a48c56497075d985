"""A page with a picture of every operation of a program on one frame."""

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import ReportError
from cnnum.graph.tracing import TraceStep
from cnnum.safety.files import write_whole
from cnnum.sharing import colours

_SIDE = 132.0
"""Width of a picture, px."""

_STYLE = """
:root { color-scheme: light dark; --paper: #fcfcfa; --ink: #16181d; --soft: #5b6270;
        --line: #d9dbe0; }
@media (prefers-color-scheme: dark) {
  :root { --paper: #14161a; --ink: #e8eaee; --soft: #9aa1ad; --line: #343841; }
}
body { margin: 0 auto; max-width: 76rem; padding: 1.5rem 1rem 4rem; background: var(--paper);
       color: var(--ink); font: 15px/1.45 system-ui, sans-serif; }
h1 { font-size: 1.5rem; margin: 0 0 .3rem; } p { color: var(--soft); max-width: 44rem; }
ol { list-style: none; margin: 1.5rem 0 0; padding: 0; display: grid; gap: .8rem;
     grid-template-columns: repeat(auto-fill, minmax(9.4rem, 1fr)); }
li { border: 1px solid var(--line); padding: .5rem; min-width: 0; }
li.output { border: 2px solid var(--ink); }
b { font-weight: 600; overflow-wrap: anywhere; } small { display: block; color: var(--soft); }
svg { display: block; width: 100%; height: auto; margin: .4rem 0; }
.number { font-size: 1.3rem; padding: .6rem 0; font-variant-numeric: tabular-nums; }
"""


def write_trace_page(path: Path, title: str, steps: Sequence[TraceStep]) -> None:
    """Write a self-contained page with every operation's result.

    Parameters
    ----------
    path : Path
    title : str
    steps : sequence of TraceStep
        Of one frame: maps (rows, cols), stacks (maps, rows, cols) or numbers.

    Raises
    ------
    ReportError
        If the file cannot be written.
    """
    cards = "\n".join(_card(step) for step in steps)
    text = (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}</title><style>{_STYLE}{colours.style_rules()}</style></head><body>"
        f"<h1>{escape(title)}: {len(steps)} operations</h1>"
        "<p>In the order in which they run. Blue is above 0, orange below; each picture has its "
        "own scale, whose end is written under it. Framed results are outputs of the program.</p>"
        f"<ol>{cards}</ol></body></html>\n"
    )
    try:
        write_whole(path, text.encode("utf-8"))
    except OSError as error:
        raise ReportError(
            f"The trace '{path}' cannot be written: {error.strerror}; check that its folder "
            "exists and may be written to."
        ) from None


def _card(step: TraceStep) -> str:
    reads = f"reads {', '.join(str(n) for n in step.arguments)}" if step.arguments else "&nbsp;"
    value = _number(float(step.value)) if step.value.ndim == 0 else _maps(step)
    names = f"<small>gives {escape(', '.join(step.outputs))}</small>" if step.outputs else ""
    style = " class='output'" if step.outputs else ""
    return (
        f"<li{style} id='step{step.number}'><b>{step.number} · {escape(step.operation)}</b>"
        f"<small>{reads}</small>{value}{names}</li>"
    )


def _number(value: float) -> str:
    return f"<div class='number'>{value:.5g}</div>"


def _maps(step: TraceStep) -> str:
    """Return the picture of a map, or of a stack's maps in reading order, on one scale."""
    values = step.value.reshape(-1, *step.value.shape[-2:])
    count, rows, cols = values.shape
    top = float(np.abs(values).max())
    across = math.ceil(math.sqrt(count))
    # a gap of a cell between the maps of a stack
    side = _SIDE / (across * (cols + 1) - 1)
    cells = "".join(
        _map(one, top, (k // across) * (rows + 1), (k % across) * (cols + 1), side)
        for k, one in enumerate(values)
    )
    height = (-(-count // across) * (rows + 1) - 1) * side
    note = f"±{top:.3g}" if count == 1 else f"{count} maps, ±{top:.3g}"
    return (
        f"<svg viewBox='0 0 {_SIDE:g} {height:.2f}' role='img' "
        f"aria-label='{escape(step.operation)}'>{cells}</svg><small>{note}</small>"
    )


def _map(values: Floats, top: float, below: int, right: int, side: float) -> str:
    return "".join(
        f"<rect class='k{colours.step(float(value), top)}' x='{(right + c) * side:.2f}' "
        f"y='{(below + r) * side:.2f}' width='{side + 0.2:.2f}' height='{side + 0.2:.2f}'/>"
        for (r, c), value in np.ndenumerate(values)
    )
