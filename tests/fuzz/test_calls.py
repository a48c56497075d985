"""Public functions with arguments of wrong types, shapes and sizes: one sentence, or an answer."""

import importlib
import inspect
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import cnnum
from cnnum.errors import (
    ArrayError,
    CalibrationError,
    DeviceError,
    MethodError,
    PhysicsError,
    UnknownNameError,
)
from cnnum.graph.nodes import Graph
from cnnum.tactile import halfspace
from cnnum.tactile.taxel.calibration import identity_of
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.functions import Table

ODD = [
    *(None, True, False, 0, 1, -1, 2, 0.0, -0.0, 1.5, -3, 10**6, 10**9, 10**400, -(10**400)),
    *(float("nan"), float("inf"), float("-inf"), 5e-324, 1.7e308, 1j, "", "x", "EDGE", "settle"),
    *("a\0b", "\ud800", "x" * 10_000, b"", b"bytes", [], [[]], [[[1.0]]], [[1], [2, 3]], {}, ()),
    *({"a": 1}, object(), print, int, (8, 8), (0, 8), (-1, 8), (10**7, 10**7), (8,), (8.5, 8)),
    *("periodic", "zero-flux", [None], ["x"], "NaN", "1", range(3), {1, 2}, slice(None), Ellipsis),
]
SMALL = st.sampled_from([(), (0,), (1,), (3,), (3, 3), (2, 2), (5, 5), (2, 3, 3), (0, 3), (8, 8)])
DTYPES = ["f8", "f4", "i8", "u1", "?", "c16", "O", "U3", "M8[s]", "f2"]
ARRAYS = st.sampled_from(DTYPES).flatmap(
    lambda kind: (
        SMALL.map(lambda shape: np.zeros(shape, kind))
        if kind in ("O", "U3", "M8[s]")
        else arrays(np.dtype(kind), SMALL)
    )
)
THINGS = st.one_of(st.sampled_from(ODD), ARRAYS, st.floats(), st.integers())
EYE = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
PICTURE = np.sign(np.sin(np.arange(64.0) + 0.5)).reshape(8, 8)


@cache
def engine() -> cnnum.Engine:
    return cnnum.Engine("reference")


def run(**options: Any) -> object:
    template = options.pop("template")
    return engine().run(template, **options)


def compiled(**options: Any) -> object:
    plan = engine().compile(options.pop("program"), options.pop("shape"), options.pop("needs"))
    return plan(options.pop("frame"))


def traced(name: str, **options: Any) -> Graph:
    """One of the functions of programs, on an array of 4×4 cells."""

    def function(frame: Any) -> dict[str, Any]:
        fields = {"$map": frame.normal, "$logic": frame.normal > 0.1, "$flag": frame.first}
        values = {k: fields.get(v, v) if isinstance(v, str) else v for k, v in options.items()}
        carried = [values.pop(key) for key in ("flag", "body", "first") if key in values]
        found = getattr(cnnum, name)(*carried, **values)
        several = getattr(found, "values", getattr(found, "outputs", found))
        return {"found": several[0] if isinstance(several, tuple) else several}

    return cnnum.Program(function, "traced").trace((4, 4))


def same(x: object) -> object:
    return x


def made(**options: Any) -> object:
    """A template of these parts, and a run of it where it is one."""
    template = cnnum.Template(**options)
    return engine().run(template, input=PICTURE, duration=0.5)


MATHS = {"input": PICTURE, "state": PICTURE, "duration": 1.0, "method": "auto", "rtol": 1e-3}
MATHS |= {"atol": 1e-5, "at": None, "bias": None, "mask": None, "dt": None}
PARTS = {"name": "mine", "A": EYE, "B": EYE, "z": 0.5, "tau": 1.0, "boundary": 0.0}
PARTS |= {"input_boundary": None, "initial": 0.0, "duration": 1.0, "output": "standard"}
PARTS |= {"nonlinear": (), "delayed": None, "gains": (), "check": None, "source": ""}
LINES = Table("linear", ((0.0, 0.0), (1.0, 1.0)))
CALLS: dict[str, tuple[Any, dict[str, Any]]] = {
    "Engine": (cnnum.Engine, {"name": "reference", "device": None, "precision": None}),
    "Engine.run": (run, {"template": "EDGE", **MATHS}),
    "Engine.compile": (
        compiled,
        {
            "program": cnnum.get_program("contact"),
            "shape": (4, 4),
            "needs": None,
            "frame": np.zeros((4, 4, 3)),
        },
    ),
    "Template": (made, PARTS),
    "Table.of": (Table.of, {"interpolation": "linear", "points": [[0.0, 0.0], [1.0, 1.0]]}),
    "Table": (Table, {"interpolation": "linear", "points": ((0.0, 0.0), (1.0, 1.0))}),
    "DelayedCoupling": (DelayedCoupling, {"delay": 1.0, "A": EYE, "B": EYE}),
    "NonlinearCoupling": (
        NonlinearCoupling,
        {"weights": EYE, "function": LINES, "neighbour": "u", "centre": "x"},
    ),
    "Gain": (Gain, {"table": LINES, "to": 0, "source": 0}),
    "stability_bound": (
        cnnum.stability_bound,
        {"method": "euler", "template": cnnum.get_template("DIFFUS"), "shape": (8, 8)},
    ),
    "analyse": (cnnum.analyse, {"template": cnnum.get_template("DIFFUS"), "shape": (8, 8)}),
    "TemplateBatch": (cnnum.TemplateBatch, {"template": cnnum.get_template("EDGE"), "A": EYE}),
    "TemplateBatch.of": (cnnum.TemplateBatch.of, {"templates": [cnnum.get_template("EDGE")]}),
    "analyse_program": (
        cnnum.analyse_program,
        {"program": cnnum.get_program("contact"), "shape": (4, 4), "channels": ("normal",)},
    ),
    "Check": (cnnum.Check, {"name": "rule", "parameters": {}}),
    "save_picture": (cnnum.save_picture, {"picture": PICTURE, "path": "none/none.png", "scale": 1}),
    "save_film": (
        cnnum.save_film,
        {"pictures": np.array([PICTURE]), "path": "none/none.gif", "rate": 5.0, "scale": 1},
    ),
    "save_template": (cnnum.save_template, {"template": cnnum.get_template("EDGE"), "path": 7}),
    "get_template": (cnnum.get_template, {"name": "EDGE"}),
    "get_program": (cnnum.get_program, {"name": "contact"}),
    "program_names": (cnnum.program_names, {"room": None}),
    "as_picture": (cnnum.as_picture, {"pixels": PICTURE}),
    "load_picture": (cnnum.load_picture, {"path": "none.png"}),
    "load_recording": (cnnum.load_recording, {"path": "none.npz"}),
    "load_template": (cnnum.load_template, {"path": "none.toml"}),
    "load_scene": (cnnum.load_scene, {"scene": "none", "changes": None}),
    "Recording": (cnnum.Recording, {"values": np.zeros((2, 4, 4, 3)), "rate": 10.0}),
    "RunSpec": (cnnum.RunSpec, {"duration": 1.0, "method": "auto", "rtol": 1e-3, "atol": 1e-5}),
    "Frame": (
        cnnum.Frame,
        {
            "values": np.zeros((2, 2, 1)),
            "channels": ("normal",),
            "unit": "V",
            "sequence": 0,
            "time": 0.0,
        },
    ),
}
IN_PROGRAMS: dict[str, dict[str, Any]] = {
    "where": {"condition": "$logic", "yes": "$map", "no": 0.0},
    "logic": {"table": "0110", "a": "$logic", "b": "$flag"},
    "maximum": {"a": "$map", "b": 1.0},
    "sqrt": {"a": "$map"},
    "branch": {"flag": "$flag", "body": same, "first": "$map"},
    "loop": {"body": same, "first": "$map", "limit": 3, "until": None},
    "shift": {"field": "$map", "rows": 1, "cols": 0, "boundary": 0.0},
    "apply": {"template": cnnum.get_template("EDGE"), "input": "$map", "state": None, "bias": None},
    "transient": {
        "template": cnnum.get_template("HERRING"),
        "input": "$map",
        "previous": "$map",
        "mask": "$logic",
        "weights": (),
        "spec": None,
    },
}
"""Those that take fields; "$map", "$logic" and "$flag" stand for fields of the frame."""
CALLS |= {name: (partial(traced, name), base) for name, base in IN_PROGRAMS.items()}
ROOMS = ("contact", "cover", "halfspace", "inverse", "taxel")
FORMS = {"x": 1e-3, "y": 0.0, "z": 2e-3, "force": [0.0, 0.0, 1.0], "poisson": 0.4}


def forms() -> dict[str, tuple[Any, dict[str, Any]]]:
    """The closed forms, with arguments made from the names of their parameters."""
    found = {}
    for room in ROOMS:
        module = importlib.import_module(f"cnnum.tactile.{room}")
        for name in module.__all__:
            one = getattr(module, name)
            if not callable(one) or getattr(one, "_is_protocol", False):
                continue
            try:
                parameters = inspect.signature(one).parameters
            except (TypeError, ValueError):
                continue
            base = {
                key: FORMS.get(key, 1e-3)
                for key, parameter in parameters.items()
                if parameter.default is parameter.empty
                and parameter.kind is not parameter.VAR_KEYWORD
            }
            found[f"{room}.{name}"] = (one, base)
    return found


FORMS_BY_NAME = forms()


def changes(base: dict[str, Any]) -> st.SearchStrategy[dict[str, Any]]:
    """One or two of the arguments replaced by anything."""
    names = st.sampled_from(sorted(base))
    return st.lists(st.tuples(names, THINGS), min_size=1, max_size=2).map(
        lambda pairs: base | dict(pairs)
    )


@pytest.mark.parametrize("name", CALLS)
def test_calls_answer_or_are_refused(name, fuzz, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # some write files
    call, base = CALLS[name]
    fuzz(changes(base), lambda options: call(**options))


@pytest.mark.parametrize("name", IN_PROGRAMS)
def test_calls_in_programs_are_traced(name):
    """Unless they are, those with changed arguments would be refused for another reason."""
    assert "found" in traced(name, **IN_PROGRAMS[name]).outputs


@pytest.mark.parametrize("room", ROOMS)
def test_closed_forms_answer_or_are_refused(room, fuzz):
    named = [name for name in FORMS_BY_NAME if name.startswith(f"{room}.")]
    cases = st.sampled_from(named).flatmap(
        lambda name: st.tuples(st.just(name), changes(FORMS_BY_NAME[name][1] or {"_": 0}))
    )

    def call(case):
        name, options = case
        FORMS_BY_NAME[name][0](**{key: value for key, value in options.items() if key != "_"})

    with np.errstate(all="ignore"):
        fuzz(cases, call)


def test_finds_of_long_runs_are_refused():
    with pytest.raises(DeviceError, match="got True"):
        cnnum.Engine("opencl", device=True)
    for precision in (np.zeros(0), [None], 0, True):
        with pytest.raises(UnknownNameError, match="precision"):
            cnnum.Engine(precision=precision)
    with pytest.raises(MethodError, match="stopped"):
        made(**(PARTS | {"tau": 1.7780314400531507e-77}))
    with pytest.raises(CalibrationError, match="NoneType"):
        identity_of(None)


@pytest.mark.parametrize("name", ["depth", "poisson"])
@pytest.mark.parametrize("value", [None, "deep", np.array(None), np.zeros(2)])
def test_a_depth_or_ratio_of_a_load_map_that_is_no_number_is_refused(name, value):
    given = {"traction": np.zeros((3, 3, 3)), "spacing": 1e-3, "depth": 1e-3, "poisson": 0.4}
    with pytest.raises((PhysicsError, ArrayError), match=f"'{name}'"):
        halfspace.surface_load_strain(**(given | {name: value, "youngs_modulus": 1e5}))
