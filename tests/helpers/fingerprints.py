"""Hashes of all that engines make of templates and programs, to compare two versions of the code.

`python tests/helpers/fingerprints.py OUT.json` writes one hash a case: texts of kernels, exported
C, and results to the last bit. `python tests/helpers/fingerprints.py OUT.json BEFORE.json` also
says which cases differ, and exits with 1 if any do. `--only TEXT` takes the cases whose names have
that text, and `--every N` every N-th of them.
"""

import hashlib
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import cnnum
from cnnum.embedded.formats import precision_named
from cnnum.embedded.making import make
from cnnum.engines.registry import open_backend
from cnnum.errors import CnnumError
from cnnum.frame import FORCE_AXES
from cnnum.graph.nodes import RunSpec
from cnnum.graph.schedule import schedule
from cnnum.programs.library import get_program, program_names
from cnnum.runs.planning import graph_of, plan_of
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.couplings import DelayedCoupling, Gain, Table
from cnnum.templating.library import get_template, template_names

ENGINES = (
    ("opencl", "float32"), ("opencl", "float64"), ("numba", "float32"), ("numba", "float64"),
    ("reference", "float64"),
)  # fmt: skip
SHAPES = {(8, 8): 1, (64, 64): 7, (300, 300): 31}
"""Arrays, and every how many templates each is taken for: large ones take seconds to lower."""

WHOLE = (("opencl", "q15"), ("reference", "q15"), ("reference", "q7"))
Case = tuple[str, Callable[[], object]]
Places = tuple[tuple[str, str], ...]


def cases() -> Iterator[Case]:
    """Yield the name and the making of every case."""
    yield from cases_of(ENGINES, WHOLE)
    yield from _exports()


def cases_of(real: Places, whole: Places) -> Iterator[Case]:
    """Yield those of engines and precisions, in real and in whole numbers."""
    yield from _sources(real)
    yield from _programs((*real, *(place for place in whole if place[1] == "q15")))
    yield from _runs((*real, *whole))


def _sources(places: Places) -> Iterator[Case]:
    backends = {each: open_backend(each[0], None, each[1]) for each in places}
    for number, name in enumerate(template_names()):
        for (engine, precision), backend in backends.items():
            for shape in (each for each, n in SHAPES.items() if number % n == 0):

                def text(name: str = name, backend: Any = backend, shape: Any = shape) -> object:
                    return _text(_plan(name, backend, shape))

                yield f"source {name} {engine} {precision} {shape[0]}x{shape[1]}", text


def _plan(name: str, backend: Any, shape: tuple[int, int]) -> Any:
    template = get_template(name)
    starts = template.initial == "input" and not template.inputs
    roles = ("state",) if starts else ("input",) * bool(template.inputs)
    roles = roles or ("state",)
    counts = {"input": template.inputs, "state": template.layers}
    names = [f"{role} {n}" for role in roles for n in range(counts[role])]
    graph = graph_of(template, shape, names, RunSpec(None, "auto", 1e-4, 1e-5, None))
    return plan_of(template.name, graph, names, None, backend)


def _text(plan: Any) -> object:
    """Return what a plan is: its text, its figures and how each transient runs."""
    made = plan.executable
    solvers = [(k, s.method, s.reason) for k, s in sorted(plan.solvers.items())]
    figures = (made.launches, made.private_bytes, made.local_bytes, made.scratch_bytes)
    return (plan.source, figures, solvers, sorted(made.strategies.items()))


def _programs(places: Places) -> Iterator[Case]:
    for name in program_names():
        for engine, precision in places:

            def text(name: str = name, of: Any = (engine, precision)) -> object:
                made = cnnum.Engine(of[0], precision=of[1])
                return _text(made.compile(name, (8, 8), channels=_channels(name)))

            yield f"program {name} {engine} {precision}", text


def _channels(name: str) -> tuple[str, ...]:
    return ("picture", "mask") if name in program_names("pictures") else FORCE_AXES


def _exports() -> Iterator[Case]:
    for name in program_names("tactile"):
        for kind in ("q15", "q7", "float32"):

            def exported(name: str = name, kind: str = kind) -> object:
                frames = np.random.default_rng(3).uniform(-1.0, 1.0, (4, 8, 8, 3))
                wanted = schedule(get_program(name).trace((8, 8), FORCE_AXES), FORCE_AXES, None)
                made = make(name, wanted, precision_named(kind), frames[:, np.newaxis])
                return repr(made.export(frames))

            yield f"export {name} {kind}", exported


def _runs(places: Places) -> Iterator[Case]:
    big = np.random.default_rng(5).uniform(-1.0, 1.0, (300, 300))
    for engine, precision in places:
        made = cnnum.Engine(engine, precision=precision)
        for own in _templates(200 if engine == "reference" else 60):
            role = "input" if own.inputs or own.initial == "input" else "state"
            for way, maps, options in WAYS:
                given = {role: maps, **options}
                yield f"run {own.name} {engine} {precision} {way}", partial(_bits, made, own, given)
        corner = get_template("CORNER")
        batch = TemplateBatch.of([replace(corner, z=z) for z in (-5.0, -4.0)])
        yield f"run batch {engine} {precision}", partial(_bits, made, batch, {"input": ONE})
        settled = {"input": ONE, "duration": "settle"}
        yield f"run settled batch {engine} {precision}", partial(_bits, made, batch, settled)
        if engine != "reference" and precision != "q15":
            edge = get_template("EDGE")
            yield f"run big {engine} {precision}", partial(_bits, made, edge, {"input": big})


SEVERAL = np.random.default_rng(4).uniform(-1.0, 1.0, (3, 8, 8))
ONE = SEVERAL[0]
WAYS: tuple[tuple[str, np.ndarray, dict[str, Any]], ...] = (
    ("plain", ONE, {}), ("plain several", SEVERAL, {}), ("plain small", 1e-6 * ONE, {}),
    ("settle", ONE, {"duration": "settle"}), ("settle several", SEVERAL, {"duration": "settle"}),
    ("at", ONE, {"at": [0.5, 1.0, 2.5]}), ("at small", 1e-6 * SEVERAL, {"at": [0.5, 1.0]}),
    ("dt", ONE, {"dt": 0.05}), ("estimate", ONE, {"dt": 0.05, "estimate": True}),
    ("rk4", ONE, {"method": "rk4"}), ("stages", ONE, {"method": "runge-kutta-chebyshev"}),
    ("chip", ONE, {"chip": cnnum.Chip(noise=0.01, mismatch=0.01)}),
    ("forced", ONE, {"dt": 3.0, "force": True}), ("fine", ONE, {"rtol": 1e-7, "atol": 1e-9}),
    ("implicit", ONE, {"method": "rodas3"}), ("two ends", ONE, {"at": [1.0], "duration": 2.0}),
    ("propagator", ONE, {"method": "propagator"}), ("masked", ONE, {"mask": ONE > 0.3}),
)  # fmt: skip


def _templates(every: int) -> Iterator[cnnum.Template]:
    """Yield some of the library, and one for each way that a run may take."""
    named = map(get_template, template_names())
    yield from [each for each in named if each.layers == 1][::every]
    heat = _row(1.0, 3.0, 1.0) + _row(1.0, 0.0, 1.0).T
    yield cnnum.Template("growing", heat, output="linear", boundary="zero-flux", duration=6.0)
    chain, driven = np.zeros((2, 2, 1, 1)), [[[[1.0]]], [[[0.0]]]]
    chain[1, 0] = 1.0  # a slow layer drives a fast one, which takes implicit steps
    yield cnnum.Template("stiff", 3.0 * chain, driven, 1.5, tau=(1.0, 1e-6), duration=2.0)
    delayed = DelayedCoupling(0.4, _row(0.0, -0.6, 0.1)[None, None], np.full((1, 1, 1, 1), 0.2))
    yield cnnum.Template("delayed", [[0.5]], [[1.0]], duration=2.0, initial=0.1, delayed=delayed)
    pulse = Table("linear", ((0.0, 1.0), (0.7, 1.5), (2.0, 0.5)))
    cross = _row(0.3, 1.2, 0.3) + _row(0.3, 0.0, 0.3).T
    yield cnnum.Template("gained", cross, [[1.0]], duration=2.0, gains=[Gain(0, 0, pulse)])


def _row(*weights: float) -> np.ndarray:
    kernel = np.zeros((3, 3))
    kernel[1] = weights
    return kernel


def _bits(engine: Any, template: Any, given: dict[str, Any]) -> object:
    """Return all of a result twice, the second time of a run that may be prepared."""
    found: list[object] = []
    for _ in range(2):
        result = engine.run(template, **given)
        for name in ("output", "state", "time", "steps", "settled", "error"):
            value = np.asarray(getattr(result, name))
            found += [name, value.dtype.str, value.shape, value.tobytes()]
        found += [result.method, result.reason, result.times]
    return found


def fingerprint(case: Callable[[], object]) -> str:
    """Return the hash of what a case makes, or the sentence with which it is refused."""
    try:
        made = repr(case())
    except CnnumError as error:
        return f"{type(error).__name__}: {error}"
    return hashlib.sha256(made.encode()).hexdigest()[:24]


def main(arguments: list[str]) -> int:
    """Write the hashes, one a line as they are made, and compare them."""
    every, only = 1, ""
    for name in ("--every", "--only"):
        if name in arguments:
            at = arguments.index(name)
            value = arguments[at + 1]
            every, only = (int(value), only) if name == "--every" else (every, value)
            del arguments[at : at + 2]
    out, *before = arguments
    known = _read(before[0]) if before else {}
    wanted = [(name, make) for name, make in cases() if only in name][::every]
    count = differ = 0
    with Path(out).open("w", encoding="utf-8") as file:
        for name, make in wanted:
            found = fingerprint(make)
            file.write(json.dumps([name, found]) + "\n")
            file.flush()
            count += not known or name in known
            if known.get(name, found) != found:
                differ += 1
                print(f"{name}\n  {known[name]}\n  {found}", flush=True)
    print(f"{count} cases, {differ} differ")
    return 1 if differ else 0


def _read(path: str) -> dict[str, str]:
    lines = Path(path).read_text(encoding="utf-8").splitlines()
    return dict(json.loads(line) for line in lines)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
