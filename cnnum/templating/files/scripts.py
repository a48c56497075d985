"""A template as a script that another program runs: MatCNN, celnn or PyCNN.

Each script holds the numbers, reads an input picture, and writes the output. Black is +1 and white
−1, and a kernel is a correlation, as here: the script turns pictures and kernels into the other
program's where those differ. Sources: `loadtem.m`, `runtem.m` and `cnn_setenv.m` of MatCNN 2.1;
celnn 1.0; `pycnn.py` of github.com/ankitaggarwal011/PyCNN.
"""

import math
from collections.abc import Callable

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import NotSupportedError, name_error
from cnnum.templating.boundary import Boundary
from cnnum.templating.files.entry import Entry
from cnnum.templating.files.matcnn_format import MATCNN
from cnnum.templating.files.unsaid import comments, unsaid
from cnnum.templating.template import Template

STEP = 0.05
"""Longest step of Euler's method, in τ."""

SETTLED = 1e-4
"""Change of the state in 5 τ below which a script in Python stops, where it runs to settle."""

LONGEST = 10_000.0
"""τ after which such a script gives up."""

PER_CELL = 2.0
"""τ that a template which runs to settle gets for each cell of the longer side in MatCNN: twice the
time that a wave takes that goes on by a cell a time constant."""


def script(entry: Entry, program: str) -> str:
    """Return the text of a script that runs a template in another program.

    Parameters
    ----------
    entry : Entry
    program : str
        "matcnn", "celnn" or "pycnn".

    Raises
    ------
    UnknownNameError
        If there is no such program.
    NotSupportedError
        If the program cannot run the template.
    """
    if program not in PROGRAMS:
        raise name_error("program", program, PROGRAMS)
    return PROGRAMS[program](entry)


def _matcnn(entry: Entry) -> str:
    template = entry.template
    records = MATCNN.write(entry)
    _refuse("MatCNN", template, _too_wide(template))
    boundary = _relevant("MatCNN", template)
    edge, what = {"symmetric": (2.0, "  % zero-flux"), "wrap": (3.0, "  % periodic")}.get(
        boundary.pad_mode, (_level(boundary.constant), "")
    )
    name = records.splitlines()[0].removeprefix("% ")
    side = 2 * max(template.radius, 1) + 1
    zeros = f"zeros({side})"
    fields = [f"{name}_A = {_padded(template.A[0, 0], side)};"]
    control = _padded(template.B[0, 0], side) if template.inputs else zeros
    kinds = {part for part in ("Aa", "Bb", "Dd") if f"\n{name}_{part} = " in records}
    steps = math.ceil(1.0 / _step(template))
    time = (
        f"max(5, {PER_CELL:g} * max(size(picture)))"
        if template.duration == "settle"
        else repr(template.duration)
    )
    start = (
        "picture" if template.initial == "input" else f"{template.initial!r} * ones(size(picture))"
    )
    lines = [
        f"% The template {name}, run by MatCNN 2.1: set the names of the pictures, and run it.",
        *records.splitlines()[1:],
        *comments(unsaid(entry, MATCNN, records)).splitlines(),
        "cnn_setenv;",
        "picture = imread('input.bmp');",
        "picture = 1 - 2 * double(picture(:, :, 1)) / 255;  % black is +1, white -1",
        *(
            ["state = imread('state.bmp');", "state = 1 - 2 * double(state(:, :, 1)) / 255;"]
            if template.needs_state
            else [f"state = {start};"]
        ),
        f"duration = {time};",
        f"mCNN.TemName = '{name}';",
        f"mCNN.TemType = {2 if 'Dd' in kinds else 1 if kinds else 0};",
        f"mCNN.Nbr = {max(template.radius, 1)};",
        f"mCNN.Atem = reshape({fields[0].split(' = ')[1].rstrip(';')}, [], 1);",
        f"mCNN.Btem = reshape({control}, [], 1);",
    ]
    for part, at in (("Aa", "At_n"), ("Bb", "Bt_n"), ("Dd", "Dt_n")):
        letter = part[1]
        if part in kinds:
            lines += [
                f"mCNN.{at} = {name}_{part}(:);",
                f"mCNN.nlin_{letter} = {name}_{letter};",
            ]
        else:
            lines += [f"mCNN.{at} = zeros(9, 1);", f"mCNN.nlin_{letter} = [0 0];"]
    lines += [
        f"mCNN.I = {float(template.z[0])!r};",
        f"mCNN.Boundary = {edge!r};{what}",
        f"mCNN.TimeStep = 1 / {steps};",
        f"mCNN.IterNum = ceil({steps} * duration);",
        "mCNN.INPUT1 = picture;",
        "mCNN.STATE = state;",
        "runtem;",
        "result = max(min(mCNN.OUTPUT, 1), -1);",
        "imwrite(uint8(round(255 * (1 - result) / 2)), 'output.bmp');",
    ]
    return "\n".join([*lines, ""])


def _too_wide(template: Template) -> dict[str, bool]:
    wide = any(coupling.weights.shape[-1] > 3 for coupling in template.nonlinear)
    return {"a radius above 2": template.radius > 2, "nonlinear couplings of radius 2": wide}


def _celnn(entry: Entry) -> str:
    template = entry.template
    _refuse_nonlinear("celnn", template, ("standard", "linear", "tanh"))
    boundary = _relevant("celnn", template)
    mode = {"symmetric": "mirror", "wrap": "wrap"}.get(boundary.pad_mode, "constant")
    activation = {"standard": "piecewise_linear", "linear": "identity", "tanh": "tanh"}
    body = f"""
    network = CellularNetwork(
        picture{"" if template.inputs else " * 0.0"},
        initial_state=start,
        feedback=A,
        control=B,
        bias=z,
        activation="{activation[template.output.name]}",
        boundary="{mode}",
        boundary_value={_level(boundary.constant)!r},
    )

    def advance(time):
        network.run(SimulationConfig(t_end=time, dt={_step(template)!r}, solver="euler"))
        return network.state

"""
    imports = "from celnn import CellularNetwork, SimulationConfig"
    return _python(entry, "celnn", ["", imports], body, "network.output(state)")


def _pycnn(entry: Entry) -> str:
    template = entry.template
    _refuse_nonlinear("PyCNN", template, ("standard",))
    feedback = _reads_others(template.A)
    fixed = template.boundary.constant
    if feedback and fixed is None:
        raise _refusal("PyCNN", template, f"the boundary '{template.boundary.name}'")
    edges = template.input_boundary
    mode = {"symmetric": '"symmetric"', "wrap": '"wrap"'}.get(edges.pad_mode, '"constant"')
    value = f", constant_values={edges.constant!r}" if edges.constant is not None else ""
    body = f"""
    cnn = PyCNN()
    cnn.n, cnn.m = start.shape
    # PyCNN turns kernels by 180 degrees, and takes 0 for the cells beyond the rim
    rim = B.shape[0] // 2
    given = np.pad(picture, rim, mode={mode}{value})
    drive = signal.convolve2d(given, B[::-1, ::-1], "valid")
    beyond = np.pad(np.zeros(start.shape), A.shape[0] // 2, constant_values={_level(fixed)!r})
    drive = drive + signal.convolve2d(beyond, A[::-1, ::-1], "valid")
    solver = integrate.ode(cnn.f).set_integrator("vode", rtol=1e-6, atol=1e-8, nsteps=100_000)
    solver.set_initial_value(start.ravel(), 0.0).set_f_params(z, drive, A[::-1, ::-1])

    def advance(time):
        state = solver.integrate(solver.t + time)
        if not solver.successful():
            raise SystemExit("SciPy's solver did not reach the end.")
        return state.reshape(start.shape)

"""
    imports = [
        "from scipy import integrate, signal",
        "",
        "from pycnn import PyCNN  # pycnn.py of github.com/ankitaggarwal011/PyCNN",
    ]
    return _python(entry, "PyCNN", imports, body, "cnn.cnn(state)")


PROGRAMS: dict[str, Callable[[Entry], str]] = {
    "matcnn": _matcnn,
    "celnn": _celnn,
    "pycnn": _pycnn,
}


def _python(entry: Entry, program: str, imports: list[str], body: str, output: str) -> str:
    """Return a script in Python; `body` makes the network and `advance`, which runs it on."""
    template = entry.template
    side = 2 * max(template.radius, 1) + 1
    duration = template.duration
    tau = float(template.tau[0])
    start = (
        "picture"
        if template.initial == "input"
        else f"np.full(picture.shape, {template.initial!r})"
    )
    second = " STATE.png" if template.needs_state else " [STATE.png]"
    control = _rows(template.B[0, 0], side) if template.inputs else f"np.zeros(({side}, {side}))"
    ending = (
        f"""    state, change, time = start, np.inf, 0.0
    while change > {SETTLED!r}:  # until it settles
        before, state, time = state.copy(), advance(5.0).copy(), time + 5.0
        change = np.abs(state - before).max()
        if time > {LONGEST!r}:
            raise SystemExit("The array does not settle.")
"""
        if duration == "settle"
        else f"    state = advance({duration / tau!r}){_unit(tau)}\n"
        if duration
        else "    state = start\n"
    )
    wishes = (
        """    if state is None:
        raise SystemExit("This template needs two pictures: an input and a state.")
"""
        if template.needs_state
        else ""
    )
    return f'''"""The template {template.name}, run by {program}.

python THIS.py INPUT.png OUTPUT.png{second}
"""

import sys

import numpy as np
{chr(10).join(line for line in imports if line)}
from PIL import Image

A = {_rows(template.A[0, 0], side)}
B = {control}
z = {float(template.z[0])!r}


def run(picture, state=None):
    """Return the output for an input picture, and an initial state: black is +1, white -1."""
{wishes}    start = {start} if state is None else state
{body.strip(chr(10))}

{ending}    return {output}


def load(name):
    return 1.0 - 2.0 * np.asarray(Image.open(name).convert("L"), float) / 255.0


def save(picture, name):
    levels = 255.0 * (1.0 - np.clip(picture, -1.0, 1.0)) / 2.0
    Image.fromarray(np.rint(levels).astype(np.uint8)).save(name)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        raise SystemExit(__doc__)
    save(run(load(sys.argv[1]), *(load(name) for name in sys.argv[3:4])), sys.argv[2])
'''


def _unit(tau: float) -> str:
    return "" if tau == 1.0 else f"  # in time constants of {tau:g}"


def _step(template: Template) -> float:
    """Return a step of Euler's method within the bound 1 / (1 + Σ|A|) of a cell's fastest rate."""
    return min(STEP, 1.0 / math.ceil(1.0 + float(np.abs(template.A).sum())))


def _refuse(program: str, template: Template, wrong: dict[str, bool]) -> None:
    for what, present in wrong.items():
        if present:
            raise _refusal(program, template, what)


def _refusal(program: str, template: Template, what: str) -> NotSupportedError:
    return NotSupportedError(f"Template '{template.name}' has {what}, which {program} cannot run.")


def _refuse_nonlinear(program: str, template: Template, outputs: tuple[str, ...]) -> None:
    wrong = {
        "several layers or inputs": template.layers > 1 or template.inputs > 1,
        "nonlinear couplings": bool(template.nonlinear),
        "a delay": template.delayed is not None,
        "gains in time": bool(template.gains),
        f"the output '{template.output.name}'": template.output.name not in outputs,
    }
    _refuse(program, template, wrong)


def _reads_others(kernels: Floats) -> bool:
    """Return whether a cell reads other cells, so that a boundary matters."""
    middle = kernels.shape[-1] // 2
    others = kernels.copy()
    others[..., middle, middle] = 0.0
    return bool(others.any())


def _relevant(program: str, template: Template) -> Boundary:
    """Return the one boundary that matters, of the state or of the input."""
    state = _reads_others(template.A) or bool(template.nonlinear)
    inputs = _reads_others(template.B) if template.inputs else False
    if state and inputs and template.boundary != template.input_boundary:
        raise _refusal(program, template, "a boundary of the input other than that of the state")
    return template.input_boundary if inputs and not state else template.boundary


def _level(constant: float | None) -> float:
    """Return the output of a cell beyond the rim."""
    return 0.0 if constant is None else max(-1.0, min(1.0, constant))


def _wide(kernel: Floats, side: int) -> Floats:
    return np.pad(kernel, (side - len(kernel)) // 2)


def _rows(kernel: Floats, side: int) -> str:
    rows = "".join(f"        {row},\n" for row in _wide(kernel, side).tolist())
    return f"np.array(\n    [\n{rows}    ]\n)"


def _padded(kernel: Floats, side: int) -> str:
    rows = _wide(kernel, side).tolist()
    return "[" + "; ".join(" ".join(repr(value) for value in row) for row in rows) + "]"
