"""Tracing programs: operations recorded, equal ones merged, and faults refused."""

import re

import numpy as np
import pytest

import cnnum
from cnnum.errors import ArrayError, ProgramError, UnknownNameError
from cnnum.graph.nodes import Apply, Transient
from cnnum.graph.schedule import schedule

EDGE = cnnum.Template(
    "edge", [[0, 0, 0], [0, 1, 0], [0, 0, 0]], [[-1, -1, -1], [-1, 8, -1], [-1, -1, -1]], -1.0
)


def traced(function, shape=(4, 4)):
    return cnnum.Program(function, "traced").trace(shape)


def count(nodes, kind):
    return sum(isinstance(node.operation, kind) for node in nodes)


def test_equal_operations_are_one_node():
    def twice(frame):
        return {"a": abs(frame.normal) + 1.0, "b": abs(frame.normal) + 1.0}

    graph = traced(twice)
    assert graph.outputs["a"] is graph.outputs["b"]
    assert graph.shared == 2
    assert count(graph.nodes, Apply) == 2


def test_equal_templates_run_once():
    again = cnnum.Template("other name", EDGE.A, EDGE.B, -1.0)

    def both(frame):
        return {
            "a": cnnum.apply(EDGE, input=frame.normal),
            "b": cnnum.apply(again, input=frame.normal),
        }

    assert count(traced(both).nodes, Transient) == 1


def test_what_nothing_wants_is_gone():
    def two(frame):
        return {
            "touched": (frame.normal > 0.1).any(),
            "edges": cnnum.apply(EDGE, input=frame.shear_x),
        }

    thinned = schedule(traced(two), ("shear_x", "shear_y", "normal"), ["touched"])
    assert thinned.channels_read == ("normal",)
    assert not thinned.transients
    what = {item.what for item in thinned.left_out}
    assert {"output edges", "channel shear_x", "channel shear_y", "template edge"} <= what


def test_memory_keeps_alive_what_it_stores():
    def drift(frame):
        memory = frame.memory()
        memory.store(cnnum.apply(EDGE, input=frame.normal))
        return {"before": memory.value, "now": frame.shear_x}

    graph = traced(drift)
    kept = schedule(graph, ("shear_x", "shear_y", "normal"), ["before"])
    assert len(kept.transients) == 1
    assert kept.channels_read == ("normal",)
    assert not schedule(graph, ("shear_x", "shear_y", "normal"), ["now"]).memories


def test_deep_programs_do_not_exhaust_the_stack():
    def deep(frame):
        value = frame.normal
        for step in range(5000):
            value = value + float(step)
        return {"value": value}

    assert len(schedule(traced(deep), ("normal",), None).nodes) > 5000


@pytest.mark.parametrize(
    ("function", "error", "words"),
    [
        (lambda frame: {"a": 1.0 if frame.normal > 0 else 0.0}, ProgramError, "cnnum.where"),
        (lambda frame: {"a": frame.normal & frame.shear_x}, ProgramError, "compare"),
        (lambda frame: {"a": cnnum.where(frame.normal, 1.0, 0.0)}, ProgramError, "logic"),
        (lambda frame: {"a": frame.normal.sum().sum()}, ProgramError, "whole map"),
        (lambda frame: {"a": frame.normal.any()}, ProgramError, "logic map"),
        (lambda frame: {"a": frame.pressure}, ProgramError, "'shear_x'"),
        (lambda frame: {"a": frame.normal + np.zeros((2, 2))}, ArrayError, "(4, 4)"),
        (lambda frame: {"a": frame.normal + np.nan}, ArrayError, "finite"),
        (lambda frame: frame.normal, ProgramError, "dict"),
        (lambda frame: {}, ProgramError, "dict"),
        (lambda frame: {"a": cnnum.apply(EDGE)}, ProgramError, "map"),
        (lambda frame: {"a": cnnum.logic("01", frame.first, frame.first)}, ProgramError, "0110"),
    ],
)
def test_bad_programs_are_refused_with_one_sentence(function, error, words):
    with pytest.raises(error, match=re.escape(words)):
        traced(function)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda f: cnnum.where(True, f, 0.0), "'condition' must be of the type Field, got bool"),
        (lambda f: cnnum.logic(None, f > 0.0, f > 1.0), "'table' must be of the type str"),
        (lambda f: cnnum.logic("0110", f > 0.0, True), "'b' must be of the type Field, got bool"),
        (lambda f: cnnum.branch(True, lambda x: x, f), "'flag' must be of the type Field"),
        (lambda f: cnnum.loop(None, f, limit=2), "'body' of a loop must be a function"),
        (lambda f: cnnum.loop(lambda x: x, f, limit=2, until=1.0), "'until' of a loop must be"),
        (lambda f: cnnum.loop(lambda x: None, f, limit=2), "got one object of the type NoneType"),
        (lambda f: cnnum.apply(3.0, input=f), "Expected a template or the name of one, got"),
        (lambda f: cnnum.transient(None, input=f), "the name of one, got NoneType"),
        (lambda f: cnnum.apply(EDGE, input=1.0), "'input' must be of the type Sequence, got float"),
        (lambda f: cnnum.apply(EDGE, input=[1.0]), "'input' must be of the type Field, got float"),
        (lambda f: cnnum.apply(EDGE, input=f, mask=True), "'mask' must be of the type Field"),
        (lambda f: cnnum.apply(EDGE, input=f, mask=f), "A mask is a logic map"),
        (lambda f: cnnum.transient(EDGE, input=f, weights=1.0), "'weights' must be of the type"),
        (lambda f: cnnum.transient(EDGE, input=f, weights=[1.0]), "the type Field, got float"),
        (lambda f: cnnum.transient(EDGE, input=f, spec=1.0), "'spec' must be of the type RunSpec"),
        (lambda f: cnnum.shift(1.0, 1), "'field' must be of the type Field, got float"),
        (lambda f: cnnum.shift(f, 1.5), "'rows' of a shift must be a whole number"),
        (lambda f: cnnum.shift(f, 0, 10**9), "at most the 4 of the array, got 1000000000"),
    ],
)
def test_arguments_of_other_types_are_refused(call, words):
    with pytest.raises(ProgramError, match=re.escape(words)):
        traced(lambda frame: {"a": call(frame.normal)})


def test_a_shift_by_the_whole_array_leaves_the_boundary():
    program = cnnum.Program(lambda f: {"a": cnnum.shift(f.normal, -4, boundary=0.5)}, "gone")
    found = cnnum.Engine("reference").compile(program, (4, 4))(np.ones((4, 4, 3)))
    np.testing.assert_array_equal(found["a"], 0.5)


def test_memory_is_stored_once_and_of_its_kind():
    def twice(frame):
        memory = frame.memory()
        memory.store(frame.normal)
        memory.store(frame.shear_x)
        return {"a": memory.value}

    def mixed(frame):
        memory = frame.memory(scalar=True)
        memory.store(frame.normal)
        return {"a": memory.value}

    with pytest.raises(ProgramError, match="twice"):
        traced(twice)
    with pytest.raises(ProgramError, match="scalar="):
        traced(mixed)


def test_fields_of_two_programs_do_not_mix():
    kept = []

    def first(frame):
        kept.append(frame.normal)
        return {"a": frame.normal}

    traced(first)
    with pytest.raises(ProgramError, match="another program"):
        traced(lambda frame: {"a": frame.normal + kept[0]})


def test_unknown_need_names_the_outputs():
    with pytest.raises(UnknownNameError, match="'a'"):
        schedule(traced(lambda frame: {"a": frame.normal}), ("normal",), ["b"])


def test_parameters_are_bound_once_and_for_all():
    @cnnum.program
    def scaled(frame, gain=1.0):
        return {"a": frame.normal * gain}

    bound = scaled.bind(gain=3.0)
    plan = cnnum.Engine("reference").compile(bound, (2, 2))
    assert plan(np.ones((2, 2, 3)))["a"].tolist() == [[3.0, 3.0], [3.0, 3.0]]
    assert scaled.parameters == ()
