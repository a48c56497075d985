"""Records of learned decisions: the scaling of inputs, and the proof."""

from dataclasses import replace

import numpy as np
import pytest

from cnnum import Engine, Template
from cnnum.design.decisions import DRAWS, decision_entry, unscaled
from cnnum.errors import TemplateError
from cnnum.templating.files import load_entry, save_entry

FORM = Template(
    "EVENT", [[1.5]], np.array([0.7, -0.4]).reshape(1, 2, 1, 1), 0.2, output="tanh",
    duration=2.0,
)  # fmt: skip
MIDDLE, WIDTH = np.array([3.0, -20.0]), np.array([0.5, 4.0])


def test_scaling_is_part_of_the_weights():
    rng, engine = np.random.default_rng(1), Engine("reference")
    scaled = rng.normal(size=(50, 2, 1, 1))
    plain = scaled * WIDTH[:, np.newaxis, np.newaxis] + MIDDLE[:, np.newaxis, np.newaxis]
    expected = engine.run(FORM, input=scaled, dt=0.1, method="rk4").state
    found = engine.run(unscaled(FORM, MIDDLE, WIDTH), input=plain, dt=0.1, method="rk4").state
    # the same sums in another order: some roundings of numbers up to 30
    assert np.abs(found - expected).max() < 1e-12


def test_inputs_with_neighbours_cannot_be_unscaled():
    wide = replace(FORM, B=np.ones((1, 2, 3, 3)))
    with pytest.raises(TemplateError, match="neighbouring cells"):
        unscaled(wide, MIDDLE, WIDTH)


@pytest.mark.parametrize("change", [{"B": np.ones((1, 2, 3, 3))}, {"initial": 0.5}])
def test_templates_that_their_drive_does_not_decide_are_refused(change):
    form, inputs = replace(FORM, **change), np.zeros((4, 2, 1, 1))
    with pytest.raises(TemplateError, match="its drive alone"):
        decision_entry(form, inputs, np.ones(4), Engine("numba"), area=1.0, inputs_are="two")


def test_the_proof_counts_wrong_decisions(fast, tmp_path):
    rng, engine = np.random.default_rng(2), fast
    inputs = rng.normal(size=(400, 2, 1, 1))
    # from 0 a cell keeps the sign of its drive, so this is the decision of exact weights
    drive = 0.7 * inputs[:, 0, 0, 0] - 0.4 * inputs[:, 1, 0, 0] + 0.2
    labels = np.where(drive > 0, 1.0, -1.0)
    right = decision_entry(FORM, inputs, labels, engine, area=1.0, inputs_are="two numbers").proof
    # the worst mismatch takes a share off every term that helps, and adds it to every other
    terms = np.column_stack([[0.7, -0.4] * inputs[:, :, 0, 0], np.full(400, 0.2)]) * labels[:, None]
    for share, decides in ((0.999, True), (1.001, False)):
        worst = (terms - share * right.relative_margin * np.abs(terms)).sum(axis=1)
        assert bool(worst.min() > 0.0) is decides
    assert right.margin == pytest.approx(np.abs(drive).min(), rel=1e-12)
    assert right.examples == 400
    exact, *others = right.flips
    assert exact.rate == 0.0
    assert [one.draws for one in right.flips] == [DRAWS] * 4
    # mismatch w turns a decision where |drive| is below some w: more of them as w grows
    assert 0.0 < others[0].rate < others[1].rate < others[2].rate < 0.1
    labels[:40] *= -1.0
    entry = decision_entry(FORM, inputs, labels, engine, area=0.9, inputs_are="two numbers")
    assert entry.proof.margin < 0.0
    # a tenth of the labels are wrong: three standard deviations of 1,000 draws are 0.028
    assert abs(entry.proof.flips[0].rate - 0.1) < 0.028
    save_entry(entry, tmp_path / "event.toml")
    assert load_entry(tmp_path / "event.toml").proof.area == 0.9
