"""The kernel text of Runge–Kutta–Chebyshev steps: as many stages as a step's length needs."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.engines.opencl.rates import Instant, outputs, rates, rates_once
from cnnum.engines.opencl.stepping import Attempt, advance, growth_texts
from cnnum.engines.opencl.strip_attempts import chebyshev_attempts
from cnnum.engines.opencl.text import fill, indented
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.chebyshev import MAX_STAGES, chebyshev_method
from cnnum.integrators.choice import MAX_STEPS
from cnnum.integrators.estimate import ROUNDINGS, SAFETY
from cnnum.integrators.schemes import ChebyshevSteps


def chebyshev(text: TransientText, scheme: ChebyshevSteps, *, by_strips: bool) -> dict[str, str]:
    """Append the steps, of large arrays `by_strips`, and return the figures of the run."""
    n = text.layers * text.cells
    text.array("k0", n)
    table = text.tables.data(_coefficients())
    attempt = chebyshev_attempts(text, table) if by_strips else _sweeps(text, table)
    with text.aside() as first_rates:
        (rates_once if by_strips else _rates)(text, "x", ["k0[{at}] = rate;"], Instant())
    filled = fill(
        "chebyshev_steps",
        cells=n,
        first_step=text.number(scheme.first_step),
        duration=text.number(text.solver.duration),
        longest=text.number(chebyshev_method(MAX_STAGES).real_stability / scheme.fastest),
        fastest=text.number(scheme.fastest),
        reach=text.number(1.0 / _reach()),
        most=MAX_STAGES,
        first_rates=indented(["{", *first_rates, "}", *attempt.begin], 2),
        stages=indented(attempt.stages, 3),
        limit=MAX_STEPS,
        judge=indented(attempt.judge, 3),
        advance=indented(attempt.advance, 3),
        settle=text.number(float(scheme.settle)),
        almost_one=text.number(1.0 - 1e-6),
        exponent=text.number(-1.0 / 3.0),
        **growth_texts(text),
    )
    text.lines += [*filled.splitlines(), *attempt.end]
    figures = {"time": "time", "steps": "steps", "error": f"{text.number(SAFETY)} * error"}
    return figures | ({"settled": "settled"} if scheme.settle else {})


def _sweeps(text: TransientText, table: int) -> Attempt:
    """Return a step's statements as sweeps over all cells; in the data its rows are a `table`."""
    n = text.layers * text.cells
    for name in ("xs", "old", "k1"):
        text.array(name, n)
    with text.aside() as stage:
        body = (
            "old[{at}] = (ONE - back1 - back2) * x[{at}] + back1 * xs[{at}] + back2 * old[{at}]"
            " + h * (weight * rate + start * k0[{at}]);"
        )
        _rates(text, "xs", [body], Instant())
        # what was before is not needed any more: the two change places
        text.lines.append(f"for (int i = 0; i < {n}; ++i) {{")
        text.lines += ["    const real new = old[i]; old[i] = xs[i]; xs[i] = new;", "}"]
    with text.aside() as last_rates:
        _rates(text, "xs", ["k1[{at}] = rate;"], Instant())
    stages = fill(
        "chebyshev_stages",
        cells=n,
        most=MAX_STAGES,
        rows=table,
        stage=indented(stage, 1),
        last_rates=indented(["{", *last_rates, "}"], 0),
    )
    return Attempt([], stages.splitlines(), _judge(text), advance(text, 1), [])


def _rates(text: TransientText, state: str, then: list[str], instant: Instant) -> None:
    outputs(text, [f"{state}[{text.at(layer)}]" for layer in range(text.layers)])
    rates(text, state, then, instant)


def _reach() -> float:
    """Return the interval of stability over s² − 1."""
    return chebyshev_method(MAX_STAGES).real_stability / (MAX_STAGES**2 - 1)


def _coefficients() -> Floats:
    """Return (most + 1, most, 4) numbers: method s, stage j; the first stage's weight at j = 0."""
    table = np.zeros((MAX_STAGES + 1, MAX_STAGES, 4))
    for stages in range(2, MAX_STAGES + 1):
        method = chebyshev_method(stages)
        table[stages, 0, 2] = method.first
        table[stages, 1:stages] = method.rows
    return table


def _judge(text: TransientText) -> list[str]:
    """Return the text that finds the worst error of a step, and the change at its end."""
    tau = text.number(float(text.template.tau.max()))
    rounding = text.number(ROUNDINGS * float(np.finfo(text.tables.dtype).eps))
    scale = text.scale("fmax(fabs(x[i]), fabs(xs[i]))")
    return [
        f"for (int i = 0; i < {text.layers * text.cells}; ++i) {{",
        # Sommeijer, Shampine & Verwer 1998, section 2.2
        "    const real e = fabs(R(0.8) * (x[i] - xs[i]) + R(0.4) * h * (k0[i] + k1[i]));",
        f"    worst = greater(worst, e / {scale});",
        f"    added = greater(added, e + {rounding} * fabs(xs[i]));",
        "    speed = greater(speed, fabs(k1[i]));",
        f"    change = greater(change, fabs({tau} * k1[i]) / {text.scale('xs[i]')});",
        "}",
    ]
