"""The arithmetic of a cell with its neighbours: outputs, weighted sums, function tables."""

import math
from typing import Any

import numpy as np

from cnnum.engines.numba import codes
from cnnum.engines.numba.compiling import compiled, inlined
from cnnum.engines.numba.records import Plan, Reals


@inlined
def copy(source: Reals, target: Reals) -> None:
    """Set as many values as both have."""
    for i in range(min(source.size, target.size)):
        target[i] = source[i]


@compiled
def respond(response: Any, state: Reals, output: Reals) -> None:
    """Set y = f(x)."""
    one = state.dtype.type(1)
    if response == codes.IDENTITY:
        copy(state, output)
    elif response == codes.CLAMP:
        for i in range(state.size):
            output[i] = min(max(state[i], -one), one)
    elif response == codes.TANH:
        for i in range(state.size):
            output[i] = math.tanh(state[i])
    else:
        for i in range(state.size):
            output[i] = one if state[i] >= 0 else -one


@inlined
def _of_one(what: Any, a: Any) -> Any:
    if what == codes.NEGATE:
        return -a
    if what == codes.EXP:
        return math.exp(a)
    if what == codes.FABS:
        return abs(a)
    if what == codes.LOG:
        return math.log(a)
    if what == codes.SQRT:
        return math.sqrt(a)
    return math.tanh(a) if what == codes.TANH_OF else a


@inlined
def _of_two(what: Any, a: Any, b: Any) -> Any:
    if what == codes.ADD:
        return a + b
    if what == codes.SUBTRACT:
        return a - b
    if what == codes.MULTIPLY:
        return a * b
    if what == codes.DIVIDE:
        return a / b
    if what == codes.POW:
        return a**b
    return max(a, b) if what == codes.FMAX else min(a, b)


@inlined
def _holds(what: Any, a: Any, b: Any) -> Any:
    if what == codes.LESS:
        return a < b
    if what == codes.NOT_MORE:
        return a <= b
    if what == codes.MORE:
        return a > b
    if what == codes.NOT_LESS:
        return a >= b
    return (a == b) == (what == codes.EQUAL)


@compiled
def interpret(steps: Any, state: Reals, centre: Reals, output: Reals) -> None:
    """Set y = f(x), or f of a centre and a neighbour x, by the rows of an expression."""
    stack: Any = np.zeros((len(steps), state.size), state.dtype)
    top = -1
    for step in range(len(steps)):
        what = int(steps[step, 0])
        if what <= codes.TAKE_NUMBER:
            top += 1
            for i in range(state.size):
                if what == codes.TAKE_NUMBER:
                    stack[top, i] = steps[step, 1]
                else:
                    stack[top, i] = state[i] if what == codes.TAKE_STATE else centre[i]
        elif what <= codes.REAL:
            for i in range(state.size):
                stack[top, i] = _of_one(what, stack[top, i])
        elif what <= codes.POW:
            top -= 1
            for i in range(state.size):
                stack[top, i] = _of_two(what, stack[top, i], stack[top + 1, i])
        elif what <= codes.OTHER:
            top -= 1
            for i in range(state.size):
                stack[top, i] = 1 if _holds(what, stack[top, i], stack[top + 1, i]) else 0
        else:
            top -= 2
            first, second, third = stack[top], stack[top + 1], stack[top + 2]
            for i in range(state.size):
                if what == codes.WITHIN:
                    first[i] = min(max(first[i], second[i]), third[i])
                else:
                    first[i] = second[i] if first[i] != 0 else third[i]
    for i in range(state.size):
        output[i] = stack[0, i]


@compiled
def show(plan: Plan, state: Reals, output: Reals) -> None:
    """Set y = f(x) of the plan's own function."""
    if plan.settings[0].response == codes.EXPRESSION:
        interpret(plan.formula, state, state, output)
    else:
        respond(plan.settings[0].response, state, output)


@inlined
def largest(found: Reals, column: Any) -> Any:
    """Return the largest number of a column of the bands' findings."""
    return found[:, column].max()


@inlined
def add(factor: Any, source: Reals, total: Reals) -> None:
    """Add values, weighted by one number."""
    weight = total.dtype.type(factor)
    for i in range(total.size):
        total[i] += weight * source[i]


@inlined
def look_up(plan: Plan, table: Any, v: Any) -> Any:
    """Return a function table's value: f_k for v_{k−1} < v ≤ v_k, or between the points."""
    k, last = plan.tables[table].first, plan.tables[table].last
    places, values = plan.points[0], plan.points[1]
    between = v > places[k] and v <= places[last]
    while k < last and v > places[k]:
        k += 1
    if not (plan.tables[table].linear and between):
        return values[k]
    part = (v - places[k - 1]) / (places[k] - places[k - 1])
    return values[k - 1] + (values[k] - values[k - 1]) * part


@inlined
def mean(plan: Plan, table: Any, begin: Any, end: Any) -> Any:
    """Return a table's mean between two arguments, as `Table.mean`."""
    places, values = plan.points[0], plan.points[1]
    total = float(values[plan.tables[table].first])
    for k in range(plan.tables[table].first, plan.tables[table].last):
        low, width = float(places[k]), float(places[k + 1] - places[k])
        if plan.tables[table].linear:
            first, last = (begin - low) / width, (end - low) / width
            least, most = min(max(first, 0.0), 1.0), min(max(last, 0.0), 1.0)
            inside = 0.5 * (most - least) * (most + least)
            share = (inside + max(last, 1.0) - max(first, 1.0)) / (last - first)
        else:
            share = min(max((end - low) / (end - begin), 0.0), 1.0)
        total += (values[k + 1] - values[k]) * share
    return total


@inlined
def couple(
    plan: Plan,
    kind: Any,
    gains: Reals,
    layer: Any,
    source: Reals,
    start: Any,
    total: Reals,
) -> None:
    """Add the weighted neighbours to `total`, whose first cell is `start` of its layer."""
    for t in range(plan.first[kind, layer], plan.first[kind, layer + 1]):
        at = start + plan.taps[t].offset
        add(plan.taps[t].weight * gains[plan.taps[t].gain], source[at : at + total.size], total)


@inlined
def bend(plan: Plan, kind: Any, work: Reals, layer: Any, start: Any, total: Reals) -> None:
    """Add nonlinear couplings to `total`, whose first cell is `start` of its layer."""
    for t in range(plan.first[kind, layer], plan.first[kind, layer + 1]):
        tap = plan.taps[t]
        weight, sign = total.dtype.type(tap.weight), total.dtype.type(tap.sign)
        neighbours = work[tap.neighbour, start + tap.offset :]
        alone = tap.centre == codes.NOTHING
        centres = work[0 if alone else tap.centre, start + tap.centre_offset :]
        if tap.operations > 0:
            steps = plan.pairs[tap.begin : tap.begin + tap.operations]
            values = np.empty(total.size, total.dtype)
            interpret(steps, neighbours[: total.size], centres[: total.size], values)
            add(weight, values, total)
            continue
        for i in range(total.size):
            v = neighbours[i] if alone else sign * (centres[i] - neighbours[i])
            value = weight * look_up(plan, tap.table, v)
            total[i] += value * v if tap.times else value
