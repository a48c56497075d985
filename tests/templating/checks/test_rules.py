"""Rules of a cell's neighbourhood, as checks write them."""

import numpy as np
import pytest

from cnnum.errors import TemplateError
from cnnum.templating.boundary import parse_boundary
from cnnum.templating.checks.rules import Neighbourhood, Rule

CELLS = np.array([[[1, 1, 0], [0, 1, 0], [0, 0, 1]]], dtype=bool)


def holds(text, boundary=-1.0, inputs=None):
    seen = Neighbourhood(CELLS, parse_boundary(boundary))
    given = seen if inputs is None else Neighbourhood(inputs, parse_boundary(boundary))
    return Rule("mine", text)(seen, CELLS, given)[0].astype(int).tolist()


def test_names_are_the_neighbours():
    assert holds("nw") == [[0, 0, 0], [0, 1, 1], [0, 0, 1]]
    assert holds("e and not c") == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert holds("n", boundary=1.0)[0] == [1, 1, 1]
    assert holds("n", boundary="zero-flux")[0] == [1, 1, 0]


def test_counts_and_comparisons():
    assert holds("ring == 3") == [[0, 0, 0], [1, 1, 1], [0, 0, 0]]
    assert holds("edges + corners >= 3 and c") == [[0, 0, 0], [0, 1, 0], [0, 0, 0]]
    assert holds("ring24 >= 3") == [[1, 1, 1], [1, 1, 1], [1, 1, 1]]


def test_patterns_match_and_count_what_differs():
    assert holds("match('##./.#./..#')") == [[0, 0, 0], [0, 1, 0], [0, 0, 0]]
    assert holds("mismatch('##o/o#o/oo#') == 0") == [[0, 0, 0], [0, 1, 0], [0, 0, 0]]
    assert holds("mismatch('+++/+++/+++') == 2.5") == [[0, 0, 0], [0, 1, 0], [0, 0, 0]]


def test_the_input_may_be_another_picture():
    other = ~CELLS
    assert holds("u and not c", inputs=other) == (~CELLS[0]).astype(int).tolist()
    assert holds("u_ring >= 8", inputs=np.ones_like(CELLS))[1][1] == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("c and", "invalid syntax"),
        ("c and west", "'west'"),
        ("__import__('os')", "cannot be read"),
        ("match('##/##')", "3×3 or 5×5"),
        ("match('abc/abc/abc')", "got 'a'"),
        ("c.real", "not part of the language of rules"),
        ("c / 2", "cannot be read"),
    ],
)
def test_anything_else_is_refused(text, message):
    with pytest.raises(TemplateError, match=message):
        holds(text)
