"""The kernel text of what the cells do to each other: outputs y = f(x) and rates dx/dt."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cnnum.engines.opencl.couplings import nonlinear, table
from cnnum.engines.opencl.drive import drive_of, input_seen
from cnnum.engines.opencl.needs import delays_outputs, inputs_read, pads_outputs, pads_states
from cnnum.engines.opencl.row_sums import Seen, rows_near, sums_by_rows, sweep_sums
from cnnum.engines.opencl.strip_couplings import FROM, PAST, STATES, fed_back
from cnnum.engines.opencl.strip_rows import At
from cnnum.engines.opencl.text import rename
from cnnum.engines.opencl.transients import TransientText
from cnnum.templating.network import taps


@dataclass(frozen=True, slots=True)
class Instant:
    """When rates are evaluated: expressions of the kernel.

    Attributes
    ----------
    time : str
        Time since the start.
    past : str
        Array expression `past[...]` of the outputs a delay ago in stacked cell order; empty
        where the template has no delayed A.
    """

    time: str = "ZERO"
    past: str = ""


def declare_outputs(text: TransientText) -> None:
    """Append the padded arrays of outputs (and states), and what of their rims stays the same."""
    names = ["y", *(["xp"] if pads_states(text) else [])]
    names += ["yd"] if delays_outputs(text) else []
    boundary = text.template.boundary
    for name in names:
        text.array(name, text.layers * text.padded)
        if boundary.constant is not None:
            state = np.asarray(boundary.constant)
            value = state if name == "xp" else text.template.output.numpy(state)
            text.fill_rims(name, text.layers, boundary, float(value))


def outputs(text: TransientText, state: list[str], keep: str | None = None) -> None:
    """Append y = f(state), the state given by one expression a layer; keep it in an array."""
    template = text.template
    shown = rename(template.output.opencl, {"x": "now"})
    limits = ["now = clamp(now, -ONE, ONE);"] if template.output.limited else []
    body: list[str] = []
    for layer, expression in enumerate(state):
        place = f"{layer * text.padded} + p"
        inner = [f"real now = {expression};", *limits]
        if keep is not None:
            inner.append(f"{keep}[{text.at(layer)}] = now;")
        if pads_states(text):
            inner.append(f"xp[{place}] = now;")
        inner.append(f"y[{place}] = {shown};")
        body.append("{ " + " ".join(inner) + " }")
    text.over_grid(body)
    if template.boundary.constant is None:
        text.fill_rims("y", text.layers, template.boundary, None)
        if pads_states(text):
            text.fill_rims("xp", text.layers, template.boundary, None)


def rates(text: TransientText, state: str, then: list[str], instant: Instant) -> None:
    """Append the evaluation of `rate` = dx/dt in every cell of every layer, and `then` on it.

    In `then`, {at} is the cell's place among the stacked states, {layer} the layer's number.
    """
    _delayed_outputs(text, instant)
    _gains(text, instant)
    text.over_grid(_rate_lines(text, state, then, lambda layer: _couplings(text, layer)))


def rates_once(text: TransientText, state: str, then: list[str], instant: Instant) -> None:
    """Append the same of states whose outputs are not known, in one sweep where lanes are for it.

    What is done in `then` may not change what other cells see.
    """
    if not _sees(text):
        _gains(text, instant)
        text.over_cells(_rate_lines(text, state, then, lambda _: []))
        return
    if not once_by_rows(text):
        outputs(text, [f"{state}[{text.at(layer)}]" for layer in range(text.layers)])
        rates(text, state, then, instant)
        return
    _gains(text, instant)
    seen = _seen(text, state, instant)
    inputs = {one.name: place for place, one in enumerate(seen) if one.name.startswith("lane_u")}
    rows = rows_near(text, len(seen), inputs)
    sums = [fed_back(rows, [At(layer, 0)]) for layer in range(text.layers)]
    sweep_sums(
        text, seen, sums, _rate_lines(text, state, then, lambda layer: [f"sum += line{layer}[c];"])
    )


def once_by_rows(text: TransientText) -> bool:
    """Return whether `rates_once` needs no arrays of outputs."""
    return sums_by_rows(text)


def _sees(text: TransientText) -> int:
    """Return how many things couplings see of neighbours."""
    inputs = len(inputs_read(text))
    return pads_outputs(text) + pads_states(text) + delays_outputs(text) + inputs


def _seen(text: TransientText, state: str, instant: Instant) -> list[Seen]:
    """Return what couplings see: outputs, and those of earlier, states and inputs if they do."""
    template, layers = text.template, range(text.layers)
    boundary, fixed = template.boundary, template.boundary.constant
    rim = None if fixed is None else float(template.output.numpy(np.asarray(fixed)))
    limits = ["now = clamp(now, -ONE, ONE);"] if template.output.limited else []
    states = [[f"now = {state}[{text.at(layer)}];", *limits] for layer in layers]
    shown = f"now = {rename(template.output.opencl, {'x': 'now'})};"
    found: list[Seen] = []
    if pads_outputs(text):
        found.append(Seen(FROM, [[*each, shown] for each in states], boundary, rim))
    if pads_states(text):
        found.append(Seen(STATES, states, boundary, fixed))
    if delays_outputs(text):
        past = [[f"now = {instant.past.replace('{at}', text.at(layer))};"] for layer in layers]
        found.append(Seen(PAST, past, boundary, rim))
    return found + [input_seen(text, n) for n in inputs_read(text)]


def _rate_lines(
    text: TransientText, state: str, then: list[str], couplings: Callable[[int], list[str]]
) -> list[str]:
    """Return statements that find the rates of a cell; `couplings` returns what adds to its sum."""
    body: list[str] = ["real sum, rate;"]
    for layer in range(text.layers):
        place = text.at(layer)
        body.append(f"sum = {drive_of(text, layer)} - {state}[{place}];")
        body += couplings(layer)
        body.append(f"rate = {text.number(1.0 / float(text.template.tau[layer]))} * sum;")
        if text.template.output.limited:
            # at the rails, what drives a state outwards does nothing
            now = f"{state}[{place}]"
            body.append(
                f"rate = PICK(fabs({now}) >= ONE, PICK({now} * rate > ZERO, ZERO, rate), rate);"
            )
        if text.operands.mask is not None:
            body.append(f"rate = PICK({text.operands.mask} != ZERO, ZERO, rate);")
        body += [line.replace("{at}", place).replace("{layer}", str(layer)) for line in then]
    return body


def _couplings(text: TransientText, layer: int) -> list[str]:
    template = text.template
    gained = {gain.source: k for k, gain in enumerate(template.gains) if gain.to == layer}
    found = taps(template.A, layer)
    lines = text.weighted("y", tuple(tap for tap in found if tap.source not in gained))
    for source, k in gained.items():
        part = text.weighted("y", tuple(tap for tap in found if tap.source == source), "part")
        lines.append(f"{{ real part = ZERO; {' '.join(part)} sum += gain{k} * part; }}")
    for coupling in template.nonlinear:
        if not coupling.static and coupling.to == layer:
            lines += nonlinear(text, coupling)
    if template.delayed is not None and delays_outputs(text):
        lines += text.weighted("yd", taps(template.delayed.A, layer))
    return lines


def _gains(text: TransientText, instant: Instant) -> None:
    if not text.template.gains:
        return
    text.lines.append(f"const real since = {instant.time};")
    text.lines += [
        f"const real gain{k} = {table(text, gain.table, 'since')};"
        for k, gain in enumerate(text.template.gains)
    ]


def _delayed_outputs(text: TransientText, instant: Instant) -> None:
    if not delays_outputs(text):
        return
    text.over_grid(
        [
            f"yd[{layer * text.padded} + p] = {instant.past.replace('{at}', text.at(layer))};"
            for layer in range(text.layers)
        ]
    )
    if text.template.boundary.constant is None:
        text.fill_rims("yd", text.layers, text.template.boundary, None)


def watch_change(text: TransientText, state: str) -> list[str]:
    """Return statements that keep the largest rate, in units of the tolerance, in `change`.

    A state whose rate times its layer's τ is below the tolerance stays within about that of its
    equilibrium.
    """
    tau = text.number(float(text.template.tau.max()))
    return [f"change = greater(change, fabs({tau} * rate) / {text.scale(f'{state}[{{at}}]')});"]
