"""Fields compare, are raised to powers and go through NumPy's functions, alike on all engines."""

import re

import numpy as np
import pytest

import cnnum
from cnnum.errors import ArrayError, ProgramError
from cnnum.programs.fields import Field

SHAPE = (3, 4)
A = np.array([[-2.0, -1.5, -0.5, 0.0], [0.25, 0.5, 1.0, 1.25], [1.5, 2.0, 2.5, 3.0]])
B = np.where(np.indices(SHAPE)[1] % 2 == 0, A, 0.5)


@pytest.fixture(params=["opencl-float32", "opencl-float64", "numba-float32", "reference"])
def engine(request, engines, reference):
    return reference if request.param == "reference" else engines[request.param]


def compiled(engine, function):
    return engine.compile(cnnum.Program(function, "p"), SHAPE, channels=("a", "b"))


def values(engine, function, batch=()):
    """The function of the maps `a` and `b`, frame by frame or of a batch of frames."""
    plan = compiled(engine, lambda frame: {"out": function(frame.a, frame.b)})
    frames = np.broadcast_to(np.stack([A, B], axis=-1), (*batch, *SHAPE, 2))
    return plan(frames)["out"]


def exactly(engine, function, expected):
    for batch in ((), (17,)):  # one frame, and frames side by side in lanes
        got = values(engine, function, batch)
        np.testing.assert_array_equal(got, np.broadcast_to(expected, (*batch, *SHAPE)))


def nearly(engine, function, expected):
    rtol = 1e-5 if engine.precision == "float32" else 1e-13
    for batch in ((), (17,)):
        got = values(engine, function, batch)
        np.testing.assert_allclose(got, np.broadcast_to(expected, got.shape), rtol=rtol)


@pytest.mark.one_in(3)
def test_comparisons_look_at_values(engine):
    exactly(engine, lambda a, b: a == b, A == B)
    exactly(engine, lambda a, b: a != b, A != B)
    exactly(engine, lambda a, b: a == a, np.ones(SHAPE))
    exactly(engine, lambda a, b: a != a, np.zeros(SHAPE))
    exactly(engine, lambda a, b: a == 0.5, A == 0.5)
    exactly(engine, lambda a, b: 0.5 != a, A != 0.5)  # noqa: SIM300
    exactly(engine, lambda a, b: a == A, np.ones(SHAPE))
    exactly(engine, lambda a, b: B == a, A == B)  # noqa: SIM300
    exactly(engine, lambda a, b: a.equals(b) & (a == b), A == B)


def test_loops_end_by_equality(engine):
    def falls(frame):
        run = cnnum.loop(
            lambda x: cnnum.maximum(x - 1.0, 0.0),
            frame.a,
            until=lambda x: x.max() == 0.0,
            limit=10,
        )
        return {"value": run.value, "iterations": run.iterations, "finished": run.finished}

    got = compiled(engine, falls)(np.stack([A, B], axis=-1))
    np.testing.assert_array_equal(got["value"], np.zeros(SHAPE))
    assert (got["iterations"], got["finished"]) == (3, 1)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("power", [0, 1, 2, 3, 5, 8, 2.0, np.float64(3), np.int64(4), True])
def test_whole_powers_are_products(engine, power):
    nearly(engine, lambda a, b: a**power, A ** float(power))


@pytest.mark.one_in(2)
@pytest.mark.parametrize("power", [-1, -2, -3.0])
def test_a_negative_power_of_0_is_0_as_a_division_by_it_is(engine, power):
    safe = np.where(A == 0.0, 1.0, A)
    nearly(engine, lambda a, b: a**power, np.where(A == 0.0, 0.0, safe**power))


@pytest.mark.one_in(3)
@pytest.mark.parametrize("power", [0.5, 1.5, -0.5, 0.3])
def test_other_powers_are_0_where_the_base_is_not_above_0(engine, power):
    safe = np.where(A > 0.0, A, 1.0)
    nearly(engine, lambda a, b: a**power, np.where(A > 0.0, safe**power, 0.0))


def test_a_number_is_raised_to_a_field(engine):
    nearly(engine, lambda a, b: 2.0**a, 2.0**A)
    nearly(engine, lambda a, b: np.power(0.5, a), 0.5**A)


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda a, b: a**b, "got a field raised to a field"),
        (lambda a, b: a**A, "got a field raised to ndarray"),
        (lambda a, b: A**a, "raised to a field"),
        (lambda a, b: a**1025, "got a field raised to 1025"),
        (lambda a, b: a**np.nan, "got a field raised to nan"),
        (lambda a, b: a**np.inf, "got a field raised to inf"),
        (lambda a, b: a**1j, "got a field raised to complex"),
        (lambda a, b: a ** "2", "got a field raised to str"),
        (lambda a, b: (-2.0) ** a, "got -2 raised to a field"),
        (lambda a, b: 0.0**a, "got 0 raised to a field"),
        (lambda a, b: np.sin(a), "NumPy's 'sin' does not accept a field"),
        (lambda a, b: np.add.reduce(a), "NumPy's 'add.reduce' does not accept"),
        (lambda a, b: np.add(a, b, out=np.zeros(SHAPE)), r"NumPy's 'add(out)' does not accept"),
        (lambda a, b: A @ a, "NumPy's 'matmul' does not accept"),
        (lambda a, b: np.where(a > 0, a, b), "cnnum.where"),
        (lambda a, b: np.sum(a), "NumPy's 'sum' does not accept a field"),
        (lambda a, b: np.clip(a, 0, 1), "NumPy's 'clip' does not accept a field"),
        (lambda a, b: a if a == b else b, "cnnum.where"),
        (lambda a, b: a if a in (b, a) else b, "cnnum.where"),
        (lambda a, b: np.logical_and(a, b), "compare the numbers"),
    ],
)
def test_the_rest_is_refused_in_one_sentence(reference, function, words):
    with pytest.raises(ProgramError, match=re.escape(words)):
        compiled(reference, lambda frame: {"out": function(frame.a, frame.b)})


@pytest.mark.parametrize("other", [None, "text", np.nan, np.zeros((2, 2))])
def test_fields_compare_with_numbers_and_maps_alone(reference, other):
    for function in (lambda a: a == other, lambda a: a != other):
        with pytest.raises(ArrayError):
            compiled(reference, lambda frame, f=function: {"out": f(frame.a)})


NUMBERS = {
    np.add: lambda a, b: a + b,
    np.subtract: lambda a, b: a - b,
    np.multiply: lambda a, b: a * b,
    np.divide: lambda a, b: np.divide(a, b, out=np.zeros(SHAPE), where=b != 0),
    np.minimum: np.minimum,
    np.maximum: np.maximum,
    np.greater: np.greater,
    np.greater_equal: np.greater_equal,
    np.less: np.less,
    np.less_equal: np.less_equal,
    np.equal: np.equal,
    np.not_equal: np.not_equal,
}


def test_numpy_joins_fields_maps_and_numbers(engine):
    """All in one program: each of NumPy's functions on fields, maps and numbers."""

    def joined(ufunc, a, b):
        return {"fields": ufunc(a, b), "map first": ufunc(A, b), "map last": ufunc(a, B)}

    half = np.full(SHAPE, 0.5)
    plan = compiled(
        engine,
        lambda frame: {
            f"{ufunc.__name__} {how}": value
            for ufunc in NUMBERS
            for how, value in {
                **joined(ufunc, frame.a, frame.b),
                "number": ufunc(np.float64(0.5), frame.b),
            }.items()
        },
    )
    got = plan(np.stack([A, B], axis=-1))
    rtol = 1e-6 if engine.precision == "float32" else 1e-15
    for ufunc, expected in NUMBERS.items():
        for how in ("fields", "map first", "map last"):
            value = got[f"{ufunc.__name__} {how}"]
            np.testing.assert_allclose(value, expected(A, B), rtol=rtol)
        value = got[f"{ufunc.__name__} number"]
        np.testing.assert_allclose(value, expected(half, B), rtol=rtol)


def test_arrays_join_fields_by_operators(engine):
    nearly(engine, lambda a, b: A - b, A - B)
    nearly(engine, lambda a, b: np.float32(2.0) * b, 2.0 * B)
    nearly(engine, lambda a, b: (A <= b) & (b > 0.0), (A <= B) & (B > 0.0))  # noqa: SIM300


@pytest.mark.one_in(5)
@pytest.mark.parametrize(
    ("ufunc", "expected"),
    [
        (np.negative, -A),
        (np.absolute, abs(A)),
        (np.fabs, abs(A)),
        (np.square, A * A),
        (np.exp, np.exp(A)),
        (np.sqrt, np.sqrt(np.maximum(A, 0.0))),
    ],
)
def test_numpy_takes_fields_cell_by_cell(engine, ufunc, expected):
    nearly(engine, lambda a, b: ufunc(a), expected)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    "ufunc", [np.logical_and, np.logical_or, np.logical_xor, np.bitwise_and, np.bitwise_or]
)
def test_numpy_joins_logic(engine, ufunc):
    exactly(engine, lambda a, b: ufunc(a > 0.0, b > 0.5), ufunc(A > 0.0, B > 0.5))
    exactly(engine, lambda a, b: np.logical_not(a > 0.0), A <= 0.0)
    exactly(engine, lambda a, b: np.invert(a > 0.0), A <= 0.0)


def test_fields_are_keys_by_what_they_are():
    def keyed(frame):
        a, b = frame.a, frame.b
        found = {a: "a", b: "b"}
        assert found[a] == "a"
        assert len({a, b, a}) == 2
        assert isinstance(hash(a), int)
        assert a in {a}
        assert a in [a, b]
        return {"out": a}

    graph = cnnum.Program(keyed, "p").trace(SHAPE, ("a", "b"))
    assert graph.outputs
    assert Field.__hash__ is object.__hash__


def test_programs_are_functions_with_a_name(reference):
    with pytest.raises(ProgramError, match="use 'def'"):
        cnnum.program(lambda frame: {"out": frame.normal})
    with pytest.raises(ProgramError, match="expects a function, got int"):
        cnnum.program(3)

    def plain(frame):
        return {"out": frame.normal}

    with pytest.raises(ProgramError, match=r"@cnnum\.program"):
        reference.compile(plain, SHAPE)
    with pytest.raises(ProgramError, match=r"engine\.run"):
        reference.compile(cnnum.Template("t", [[1.0]]), SHAPE)
    assert reference.compile(cnnum.program(plain), SHAPE)
