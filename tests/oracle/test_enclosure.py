"""Rigorous enclosures certify decisions of the library's templates, and errors that are stated.

`CNNUM_FAULTS=full` takes every template that Arb's balls can follow, in some minutes.
"""

import os
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

import cnnum
from cnnum.templating.checks.registry import form_of

pytest.importorskip("flint", reason="python-flint is an extra: pip install '.[oracles]'")


def loaded():
    """Return the module of enclosures, which lies next to this file."""
    spec = spec_from_file_location("enclosure", Path(__file__).with_name("enclosure.py"))
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


ROOM = loaded()
Course, UndecidedError, balls_of, rests = (
    ROOM.Course,
    ROOM.UndecidedError,
    ROOM.balls_of,
    ROOM.rests,
)

FULL = os.environ.get("CNNUM_FAULTS") == "full"
FEW = ("EDGE", "SHADOW", "AVERAGE", "THRES")
LONGEST = 100.0
"""Time constants after which a template that settles is looked at as it is."""


def followed() -> list[str]:
    """Templates of one piecewise-linear layer."""
    found = []
    for name in cnnum.template_names():
        one = cnnum.get_template(name)
        plain = one.plain and one.output.name == "standard" and float(one.tau[0]) == 1.0
        if plain and one.layers == 1 and one.inputs <= 1 and one.check is not None:
            found.append(name)
    return found


def case_of(template, seed=3, shape=(8, 8)):
    """Input and start of a picture of the template's own check."""
    drawn = form_of(template).cases(template, np.random.default_rng(seed), shape)
    maps = {}
    for role in ("input", "state"):
        value = getattr(drawn, role)
        if value is not None:
            maps[role] = np.asarray(value).reshape(-1, *shape)[-1]
    start = maps.get("state")
    if start is None:
        given = maps.get("input")
        start = given if template.initial == "input" else np.full(shape, float(template.initial))
    return maps, start, drawn


def enclosed(template, maps, start, end):
    """The course of an array to a time, or to where every cell is saturated for good."""
    array = balls_of(template, maps.get("input", np.zeros(start.shape)))
    course = Course(array, start)
    time = 0.0
    while time < end and not rests(array, course.x):
        time = min(end, max(4.0, 2.0 * time))
        course.to(time)
    return course, rests(array, course.x)


@pytest.mark.parametrize("name", followed() if FULL else FEW)
def test_decisions_are_certified(fast, name):
    """The sign of a ball that does not hold 0 is the truth: the engine's answer has it."""
    template = cnnum.get_template(name)
    maps, start, drawn = case_of(template)
    end = LONGEST if template.duration == "settle" else float(template.duration)
    if drawn.duration is not None and drawn.duration != "settle":
        end = float(drawn.duration)
    try:
        course, settled = enclosed(template, maps, start, end)
    except UndecidedError as why:
        pytest.skip(f"undecided: {why!s:.90}")
    how = {} if template.duration == "settle" and settled else {"duration": end}
    got = fast.run(template, **maps, **how)
    output = np.ravel(got.output)
    decided = [(1 if x > 0 else -1) if x > 0 or x < 0 else 0 for x in course.x]
    for sign, value in zip(decided, output, strict=True):
        assert sign == 0 or value * sign > 0.0
    if 0 in decided:
        pytest.skip(f"undecided: {decided.count(0)} of {len(decided)} balls hold 0")


def sampled(rng):
    """A small network that may saturate, and a picture."""
    feedback = rng.normal(size=(3, 3)) * rng.uniform(0.1, 1.0)
    boundary = rng.choice(np.array([0.0, "zero-flux", "periodic"], dtype=object))
    template = cnnum.Template(
        "sampled", feedback, [[1.0]], float(rng.normal()), boundary=boundary, duration=2.0
    )
    return template, rng.uniform(-1, 1, (3, 4)), rng.uniform(-0.9, 0.9, (3, 4))


@pytest.mark.parametrize("seed", range(40 if FULL else 8))
def test_stated_errors_are_certified(seed):
    """Engines' states are within the error that they state of the truth, the balls."""
    template, picture, start = sampled(np.random.default_rng(seed))
    course = Course(balls_of(template, picture), start)
    course.to(2.0)
    truth = np.array([float(x.mid()) for x in course.x]).reshape(3, 4)
    assert max(float(x.rad()) for x in course.x) < 1e-30
    for name, rtol in (("numba", 1e-3), ("numba", 1e-6), ("reference", 1e-6)):
        engine = cnnum.Engine(name, precision="float64")
        result = engine.run(template, input=picture, state=start, rtol=rtol, atol=rtol)
        # the rounding of the truth itself in float64
        off = np.abs(result.state - truth).max() - 4.0 * np.spacing(np.abs(truth).max())
        assert off <= result.error
