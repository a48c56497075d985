"""Random nonlinear, delayed, time-varying and discrete templates agree on every engine."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.functions import Table
from cnnum.templating.template import Template

RTOL, ATOL = 1e-4, 1e-5
KINDS = {  # maps that a coupling reads: neighbour, centre
    "A": ("y", None), "A difference": ("y", "y"), "B": ("u", None), "B difference": ("u", "u"),
    "D x - u": ("u", "x"), "D x - x": ("x", "x"), "D y - u": ("u", "y"),
}  # fmt: skip


def table(rng):
    """A piecewise linear function with slopes below 1/2."""
    places = np.sort(rng.uniform(-2, 2, 4)) + np.arange(4) * 0.3
    values = np.cumsum(rng.uniform(-0.5, 0.5, 4) * np.diff(places, prepend=places[0]))
    return Table("linear", tuple(zip(places.tolist(), values.tolist(), strict=True)))


@st.composite
def templates(draw):
    """One template with one kind of coupling and a weak linear one, so that it contracts."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    boundaries = [draw(st.sampled_from([0.0, -0.5, "zero-flux", "periodic"])) for _ in range(2)]
    kind = draw(st.sampled_from([*KINDS, "delayed", "gain", "sign"]))
    feedback = rng.normal(size=(3, 3)) * 0.03
    control = rng.normal(size=(3, 3)) * 0.3
    parts = {}
    if kind in KINDS:
        neighbour, centre = KINDS[kind]
        parts["nonlinear"] = [
            NonlinearCoupling(
                rng.normal(size=(3, 3)) * 0.1, table(rng), neighbour, centre,
                reversed_sign=draw(st.booleans()),
            )
        ]  # fmt: skip
    elif kind == "delayed":
        weights = [rng.normal(size=(1, 1, 3, 3)) * 0.05 for _ in range(2)]
        parts["delayed"] = DelayedCoupling(draw(st.sampled_from([0.3, 1.0])), *weights)
    elif kind == "gain":
        points = tuple((0.5 * n, float(g)) for n, g in enumerate(rng.uniform(-1, 1, 4)))
        parts["gains"] = [Gain(0, 0, Table("linear", points))]
    output = "sign" if kind == "sign" else draw(st.sampled_from(["standard", "linear", "tanh"]))
    return Template(
        kind, feedback * (20 if kind == "sign" else 1), control, 0.1, boundary=boundaries[0],
        input_boundary=boundaries[1], initial="input", output=output, duration=2.0, **parts,
    )  # fmt: skip


@settings(max_examples=6, deadline=None)
@given(
    template=templates(),
    precision=st.sampled_from(["float32", "float64"]),
    shape=st.tuples(st.integers(2, 7), st.integers(2, 7)),
    batch=st.sampled_from([(), (3,)]),
    seed=st.integers(0, 2**16),
)
def test_every_kind_of_coupling_agrees(
    engines, names, reference, template, precision, shape, batch, seed
):
    rng = np.random.default_rng(seed)
    maps = {"input": rng.uniform(-1, 1, (*batch, *shape))}
    if template.delayed is not None:
        maps["previous"] = rng.uniform(-1, 1, (*batch, *shape))
    expected = reference.run(template, **maps).state
    if batch:
        # wider than any vector; the reference takes long for 18 frames: three by turns, whose
        # neighbours in lanes are others
        places = np.arange(18) % 3
        maps, expected = {name: frames[places] for name, frames in maps.items()}, expected[places]
    # adaptive steps: some 20 of them, each within the tolerance, in a contracting array; a delay
    # is taken in Heun's steps of 0.05, whose global error is below h²/6 of the third derivative
    largest = 1 + np.abs(expected).max()
    tolerance = 1e-3 * largest if template.delayed is not None else 20 * (ATOL + RTOL * largest)
    for name in names:
        got = engines[f"{name}-{precision}"].run(template, rtol=RTOL, atol=ATOL, **maps)
        assert np.abs(got.state - expected).max() <= tolerance
