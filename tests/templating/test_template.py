"""A template refuses to exist when its parts do not fit together."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cnnum import get_template, template_names
from cnnum.errors import ArrayError, CnnumError, TemplateError, UnknownNameError
from cnnum.templating.couplings import DelayedCoupling
from cnnum.templating.template import Check, Template

CENTRE = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]


def two_layers(k: int = 3) -> np.ndarray:
    return np.zeros((2, 2, k, k))


def test_single_layer_parts_get_their_layer_axes() -> None:
    template = Template("t", A=CENTRE, B=[[2.0]], z=-0.5)
    assert template.A.shape == (1, 1, 3, 3)
    assert template.B.shape == (1, 1, 1, 1)
    assert (template.layers, template.inputs, template.radius) == (1, 1, 1)
    assert template.z.tolist() == [-0.5]
    assert template.tau.tolist() == [1.0]


def test_input_boundary_is_the_states_unless_given() -> None:
    assert Template("t", A=CENTRE, boundary="periodic").input_boundary.name == "periodic"
    both = Template("t", A=CENTRE, boundary=-1, input_boundary="zero-flux")
    assert (both.boundary.constant, both.input_boundary.name) == (-1.0, "zero-flux")


def test_radius_is_that_of_the_wider_of_a_and_b() -> None:
    assert Template("t", A=[[1.0]], B=np.ones((5, 5))).radius == 2


def test_layers_have_their_own_bias_and_time_constant() -> None:
    template = Template("t", A=two_layers(), z=[1.0, -1.0], tau=[1.0, 10.0])
    assert template.layers == 2
    assert template.tau.tolist() == [1.0, 10.0]


def test_arrays_are_copies_that_cannot_be_written() -> None:
    weights = np.array(CENTRE)
    template = Template("t", A=weights)
    weights[1, 1] = 7.0
    assert template.A[0, 0, 1, 1] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        template.A[0, 0, 1, 1] = 2.0


def test_delayed_weights_are_copies_that_cannot_be_written() -> None:
    weights = np.full((1, 1, 3, 3), 0.5)
    late = DelayedCoupling(1.0, weights, weights)
    digest = Template("t", A=CENTRE, B=CENTRE, delayed=late).digest
    weights[...] = 7.0
    assert (late.A == 0.5).all()
    assert (late.B == 0.5).all()
    assert Template("t", A=CENTRE, B=CENTRE, delayed=late).digest == digest
    with pytest.raises(ValueError, match="read-only"):
        late.A[0, 0, 1, 1] = 2.0


def test_delayed_weights_of_one_layer_are_matrices_and_missing_ones_zeros() -> None:
    late = Template("t", A=CENTRE, B=CENTRE, delayed=DelayedCoupling(1.0, B=CENTRE)).delayed
    assert late is not None
    np.testing.assert_array_equal(late.A, np.zeros((1, 1, 1, 1)))
    np.testing.assert_array_equal(late.B, np.array(CENTRE)[None, None])


@pytest.mark.parametrize("shape", [(3,), (2, 2), (1, 1, 2, 2), (1, 1, 1, 3)])
def test_delayed_weights_have_their_shape(shape: tuple[int, ...]) -> None:
    fits = np.zeros((1, 1, 3, 3))
    for parts in ((np.zeros(shape), fits), (fits, np.zeros(shape))):
        with pytest.raises(TemplateError, match="with k odd"):
            DelayedCoupling(1.0, *parts)


def test_digest_depends_on_all_that_changes_a_run_and_on_nothing_else() -> None:
    parts: dict[str, Any] = {"A": CENTRE, "B": CENTRE, "z": 0.5}
    plain = Template("t", **parts)
    same = Template("u", **parts, description="other words", check=Check("edge"))
    assert plain.digest == same.digest
    changes: list[dict[str, Any]] = [
        {"z": 0.25},
        {"B": [[1.0]]},
        {"A": [[1.0]]},
        {"tau": 2.0},
        {"boundary": 1.0},
        {"input_boundary": "periodic"},
        {"initial": "input"},
        {"duration": 3.0},
        {"output": "tanh"},
    ]
    digests = {Template("t", **{**parts, **change}).digest for change in changes}
    assert len(digests | {plain.digest}) == len(changes) + 1


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"A": [[1.0, 0.0], [0.0, 1.0]]}, r"A must have .* with k odd, got \(2, 2\)"),
        ({"A": [[1.0, 0.0, 1.0]]}, r"A must have .* got \(1, 3\)"),
        ({"A": np.zeros((1, 2, 3, 3))}, "A couples layers to layers, got 2 columns for 1 layers"),
        ({"A": CENTRE, "B": np.zeros((2, 1, 3, 3))}, "B must have as many layers as A, 1, got 2"),
        ({"A": CENTRE, "z": [1.0, 2.0]}, "z must be one number or one per layer"),
        ({"A": CENTRE, "tau": 0.0}, "tau must be positive"),
        ({"A": CENTRE, "initial": "output"}, "initial must be a finite number or 'input'"),
        ({"A": CENTRE, "duration": -1.0}, "duration must be a number of at least 0"),
        ({"A": CENTRE, "duration": "long"}, "duration must be a number of at least 0"),
        ({"A": CENTRE, "boundary": "open"}, "Unknown boundary 'open'"),
        ({"A": CENTRE, "nonlinear": None}, "nonlinear must be a sequence of NonlinearCoupling"),
        ({"A": CENTRE, "nonlinear": [1]}, "'nonlinear' must be of the type NonlinearCoupling"),
        ({"A": CENTRE, "gains": 3}, "gains must be a sequence of Gain, got int"),
        ({"A": CENTRE, "delayed": 1.0}, "'delayed' must be of the type DelayedCoupling"),
        ({"A": CENTRE, "check": "rule"}, "'check' must be of the type Check, got str"),
        ({"A": CENTRE, "source": 7}, "'source' must be of the type str, got int"),
        (
            {"A": two_layers(), "B": np.ones((2, 1, 1, 1)), "initial": "input"},
            "needs one input per layer, got 1 inputs for 2 layers",
        ),
    ],
)
def test_parts_that_do_not_fit_are_refused(parts: dict[str, Any], message: str) -> None:
    with pytest.raises(TemplateError, match=message):
        Template("t", **parts)


def test_weights_that_are_not_finite_are_refused() -> None:
    with pytest.raises(ArrayError, match=r"^A of template 't' must be finite, got nan\.$"):
        Template("t", A=[[np.nan]])


def test_unknown_output_function_names_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="expected one of 'standard', 'linear'"):
        Template("t", A=CENTRE, output="relu")


def test_errors_are_also_the_fitting_builtins() -> None:
    with pytest.raises(ValueError, match="tau must be positive"):
        Template("t", A=CENTRE, tau=-1.0)
    with pytest.raises(CnnumError):
        Template("t", A=CENTRE, tau=-1.0)


@pytest.mark.parametrize("name", template_names())
def test_a_part_can_be_replaced(name: str) -> None:
    template = get_template(name)
    same = replace(template, name="other")
    assert (same.name, same.digest) == ("other", template.digest)
    assert same.check == template.check
    longer = replace(template, duration=7.5, z=template.z + 0.25)
    assert longer.duration == 7.5
    np.testing.assert_array_equal(longer.z, template.z + 0.25)
    np.testing.assert_array_equal(longer.B, template.B)
    assert longer.input_boundary == template.input_boundary
    assert longer.digest != template.digest


def test_a_replaced_part_must_fit() -> None:
    template = get_template("EDGE")
    with pytest.raises(TemplateError, match="tau must be positive"):
        replace(template, tau=-1.0)
    with pytest.raises((TypeError, ValueError), match="digest"):
        replace(template, digest="0" * 64)
