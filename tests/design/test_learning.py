"""Weights learned from labelled pictures, by gradients."""

import numpy as np
import pytest

from cnnum import Engine, get_template
from cnnum.design.learning import Lesson, Loss, learn, numbers_of, untied
from cnnum.design.search import groups_of
from cnnum.errors import SizeError, TemplateError


def pictures(seed, count=12, side=8):
    return np.where(np.random.default_rng(seed).random((count, side, side)) > 0.25, 1.0, -1.0)


def test_a_template_learns_edges_and_keeps_them_on_pictures_it_never_saw():
    seen, unseen = pictures(0), pictures(1)
    engine, edge = Engine("numba"), get_template("EDGE")
    target = engine.run(edge, input=seen).output
    form = untied("learned", feedback=False, boundary=edge.boundary, duration=4.0)
    made = learn(Lesson(form, target, seen, step=0.1), restarts=12, enough=1e-3)
    assert made.loss <= 1e-3
    assert made.template.A[0, 0].nonzero()[0].tolist() == [1]
    wrong = (engine.run(made.template, input=unseen).output > 0) != (
        engine.run(edge, input=unseen).output > 0
    )
    # of 512 neighbourhoods the lesson has shown some two hundred
    assert wrong.mean() <= 0.02


def test_equal_numbers_of_a_form_stay_equal_and_zeros_stay_zeros():
    form, given = get_template("DIFFUS"), pictures(2, 1)
    made = learn(Lesson(form, given, state=given, duration=1.0), restarts=1, iterations=3)
    assert [len(places) for _, places in groups_of(made.template)] == [
        len(places) for _, places in groups_of(form)
    ]
    assert np.array_equal(made.template.A != 0.0, form.A != 0.0)


def test_the_slope_of_a_loss_is_that_of_differences():
    form, given = untied("f", boundary=0.3, output="tanh", duration=1.5), pictures(3, 2)
    counts = np.abs(np.random.default_rng(1).normal(size=given.shape))
    loss = Loss(Lesson(form, -given, given, counts=counts, shrink=0.01))
    at, way = numbers_of(form, loss.groups), np.random.default_rng(2).normal(size=len(loss.groups))
    _, slopes = loss(at)
    ends = [loss(at + h * way)[0] for h in (1e-5, -1e-5)]
    # central differences: h² of the third derivative, and roundings over h
    assert (ends[0] - ends[1]) / 2e-5 == pytest.approx(slopes @ way, rel=1e-6)


def test_the_same_seed_learns_the_same():
    lesson = Lesson(untied("f", duration=1.0), pictures(4, 1), pictures(5, 1), step=0.2)
    first, second = (learn(lesson, restarts=1, iterations=5, seed=3) for _ in range(2))
    assert first.template.digest == second.template.digest


def test_lessons_that_cannot_be_learned_are_refused():
    given = pictures(6, 1)
    with pytest.raises(TemplateError, match="no gradient"):
        learn(Lesson(get_template("MAXLOC"), given, state=given))
    with pytest.raises(TemplateError, match="one start"):
        learn(Lesson(untied("f", duration=1.0), given, given), restarts=0)
    far = Loss(Lesson(untied("f", output="linear", duration=500.0), given, given, step=0.1))
    found, slopes = far(np.ones(len(far.groups)))
    assert found >= 1e6  # it diverges; the way back is to smaller weights
    assert (slopes > 0.0).all()
    with pytest.raises(SizeError, match="GiB"):
        learn(Lesson(untied("f", duration=1e5), given.repeat(100, 0), given.repeat(100, 0)))
