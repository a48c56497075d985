"""Runs as on an analogue array: coarse weights and maps, noise and mismatch, on every engine."""

import numpy as np
import pytest

from cnnum import Chip, Engine, Template, TemplateBatch, get_template
from cnnum.errors import ArrayError, MethodError, NotSupportedError

FINE = {"weight_bits": 32, "state_bits": 32}
UNCOUPLED = {"dt": 1.0, "method": "euler", "duration": 1.0}
"""Of an uncoupled template, one Euler step of one τ is x = B∗u + z, whatever the start."""


def test_numbers_are_rounded_as_their_definition_says():
    rng = np.random.default_rng(1)
    template = Template("t", rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), z=-2.5)
    own = Chip(weight_bits=6).programmed(template)
    top = max(np.abs(template.A).max(), np.abs(template.B).max(), 2.5)
    for part in ("A", "B", "z"):
        expected = np.round(getattr(template, part) / top * 31) / 31 * top
        assert np.allclose(getattr(own, part), expected, rtol=0, atol=1e-12)
    values = rng.normal(size=1000)
    expected = np.round(np.clip(values, -1, 1) * 63) / 63
    assert np.allclose(Chip(state_bits=7).stored(values), expected, rtol=0, atol=1e-12)
    assert len(np.unique(Chip(state_bits=3).stored(values))) == 7


def test_input_start_bias_and_output_are_coarse(reference):
    template = Template("t", [[0.0]], [[0.5]], duration=0.0, output="linear")
    state = np.array([[0.1, 0.9], [3.0, -0.3]])
    found = reference.run(template, input=state, state=state, chip=Chip(state_bits=4))
    # seven steps to full scale; nothing moves in no time
    assert np.allclose(found.output, np.array([[1, 6], [7, -2]]) / 7, atol=1e-12)
    bias = np.array([[4.0, 0.3], [-1.0, 2.2]])
    chip = Chip(weight_bits=32, state_bits=4, full_scale=10.0)
    found = reference.run(template, input=state, bias=bias, chip=chip, **UNCOUPLED)
    held = 0.5 * np.round(state * 0.7) / 0.7 + np.round(bias / 4 * 7) / 7 * 4
    assert np.allclose(found.state, held, atol=1e-6)  # weights of 32 bits
    assert np.allclose(found.output, np.round(held * 0.7) / 0.7, atol=1e-6)


@pytest.mark.parametrize("name", ["EDGE", "CCD_HOR", "AVERAGE"])
def test_fine_numbers_without_faults_are_the_plain_run(name, reference):
    pictures = np.sign(np.random.default_rng(2).normal(size=(2, 8, 8)))
    plain = reference.run(name, input=pictures, duration=2.0)
    fine = reference.run(name, input=pictures, duration=2.0, chip=Chip(**FINE))
    # weights off by 2^-32 of the largest, over two time constants; the solver's own 1e-8
    assert np.abs(fine.output - plain.output).max() < 1e-6
    assert np.array_equal(fine.settled, plain.settled)


@pytest.mark.parametrize("name", ["EDGE", "SHADOW", "DIFFUS"])
def test_engines_have_the_same_chip(name, names, reference):
    inputs = np.random.default_rng(3).uniform(-1, 1, (2, 8, 8))
    chip = Chip(noise=0.02, mismatch=0.03, seed=5)
    steps = {"duration": 1.5, "method": "euler", "dt": 0.0625}
    expected = reference.run(name, input=inputs, chip=chip, **steps)
    level = 1 / 127
    for engine in names:
        found = Engine(engine).run(name, input=inputs, chip=chip, **steps)
        # 24 steps in float32: some 1e-7 each of states up to 10, amplified e^3 at most
        assert np.abs(found.state - expected.state).max() < 5e-4
        apart = np.abs(found.output - expected.output)
        assert apart.max() < 1.01 * level, "at most the neighbouring level"
        assert (apart > 0.5 * level).mean() < 0.03  # 5e-4 of a level's 8e-3, and few are as far


def test_whole_numbers_have_the_same_chip_to_the_bit(opencl):
    assert opencl.name == "opencl"
    u = np.random.default_rng(0).uniform(-1, 1, (8, 8))
    chip = Chip(mismatch=0.05, noise=0.01)
    one, other = (
        Engine(name, precision="q15").run("DIFFUS", input=u, duration=1.0, chip=chip)
        for name in ("reference", "opencl")
    )
    assert np.array_equal(one.state, other.state)
    assert np.array_equal(one.output, other.output)


def test_noise_has_its_width_and_each_map_its_own(reference):
    template = Template("t", [[0.0]], duration=0.0, output="linear")
    chip = Chip(state_bits=16, noise=0.1)
    found = reference.run(template, state=np.zeros((4, 50, 50)), chip=chip).output
    # σ of 10,000 numbers is known within σ/√20,000: four of them; none of them saturates
    assert abs(found.std() - 0.1) < 4 * 0.1 / np.sqrt(2e4)
    assert abs(found.mean()) < 4 * 0.1 / 100
    assert abs(np.corrcoef(found[0].ravel(), found[1].ravel())[0, 1]) < 4 / 50


@pytest.mark.parametrize("boundary", [0.5, "zero-flux", "periodic"])
def test_mismatch_of_inputs_and_bias_differs_from_cell_to_cell(boundary, reference):
    weights = np.arange(1.0, 10.0).reshape(3, 3)
    template = Template("t", [[0.0]], weights, z=2.0, boundary=boundary, output="linear")
    chip = Chip(**FINE, mismatch=0.1, seed=7, full_scale=99.0)
    u = np.random.default_rng(8).uniform(-1, 1, (40, 30))
    plain, found = (
        reference.run(template, input=u, chip=one, **UNCOUPLED).state
        for one in (Chip(**FINE, full_scale=99.0), chip)
    )
    mode = {0.5: "constant", "zero-flux": "edge", "periodic": "wrap"}[boundary]
    padded = np.pad(u, 1, mode=mode, **({"constant_values": 0.5} if boundary == 0.5 else {}))
    power = 2.0**2 + sum(
        (weights[i, j] * padded[i : i + 40, j : j + 30]) ** 2 for i in range(3) for j in range(3)
    )
    share = (found - plain) / (0.1 * np.sqrt(power))
    # a sum of independent ε: each cell's has this width; 1,200 cells, five standard deviations
    assert abs(share.std() - 1.0) < 5 / np.sqrt(2400)
    assert abs(share.mean()) < 5 / np.sqrt(1200)
    assert abs(np.corrcoef(share[:, :-1].ravel(), share[:, 1:].ravel())[0, 1]) < 5 / np.sqrt(1160)


def test_mismatch_of_feedback_is_shared_and_has_its_width():
    template = Template("t", np.ones((3, 3)))
    drawn = np.array([Chip(mismatch=0.05, seed=n).programmed(template).A for n in range(300)])
    assert abs(drawn.std() - 0.05) < 5 * 0.05 / np.sqrt(2 * drawn.size)
    assert abs(drawn.mean() - 1.0) < 5 * 0.05 / np.sqrt(drawn.size)


def test_a_seed_is_a_chip(reference):
    u = np.random.default_rng(4).uniform(-1, 1, (3, 6, 6))

    def run(seed, inputs=u):
        chip = Chip(noise=0.05, mismatch=0.05, seed=seed)
        return reference.run("AVERAGE", input=inputs, duration=0.5, chip=chip)

    one, same, other = run(1), run(1), run(2)
    assert np.array_equal(one.output, same.output)
    assert not np.array_equal(one.state, other.state)
    # mismatch is the array's, whichever frames it sees
    assert np.allclose(run(1, u[1]).state, one.state[1], atol=1e-7)


def test_layers_inputs_masks_and_times_go_through(reference):
    rng = np.random.default_rng(6)
    a, b = 0.2 * rng.normal(size=(2, 2, 3, 3)), rng.normal(size=(2, 1, 3, 3))
    template = Template("two", a, b, z=[0.1, -0.2], duration=1.0)
    u, mask = rng.uniform(-1, 1, (3, 5, 4)), rng.random((5, 4)) < 0.3
    chip = Chip(mismatch=0.1)
    given = {"input": u, "mask": mask, "chip": chip}
    found = reference.run(template, **given)
    assert found.output.shape == (3, 2, 5, 4)
    assert (found.output[..., mask] == 0.0).all()
    times = reference.run(template, **given, at=[0.5, 1.0])
    assert times.output.shape == (2, 3, 2, 5, 4)
    assert np.allclose(times.state[1], found.state, atol=1e-5)


@pytest.mark.parametrize(
    "wrong",
    [{"weight_bits": 1}, {"state_bits": 33}, {"state_bits": 7.5}, {"noise": -0.1}, {"seed": -1},
     {"mismatch": np.nan}, {"full_scale": 0.0}, {"seed": True}, {"noise": "1"}],
)  # fmt: skip
def test_a_wrong_chip_is_refused(wrong):
    with pytest.raises(MethodError, match=rf"'{next(iter(wrong))}' of a chip must be a"):
        Chip(**wrong)


def test_templates_that_no_chip_holds_are_refused(reference):
    template, u = get_template("EDGE"), np.zeros((4, 4))
    with pytest.raises(NotSupportedError, match="one template at a time"):
        reference.run(TemplateBatch(template), input=u, chip=Chip())
    with pytest.raises(NotSupportedError, match="linear couplings"):
        reference.run("D_ANISO", input=u, chip=Chip())
    with pytest.raises(MethodError, match="'chip' must be of the type Chip"):
        reference.run(template, input=u, chip=8)
    with pytest.raises(ArrayError, match="finite"):
        reference.run(template, input=np.full((300, 300), np.inf), chip=Chip())
