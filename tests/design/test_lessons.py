"""Specifications that ask for gradients: a lesson of a check or of examples, and a record."""

import numpy as np
import pytest

from cnnum import Engine, get_template
from cnnum.design.designing import designed, is_spec, lesson_of, load_spec
from cnnum.errors import TemplateError
from cnnum.templating.checks import run_check
from cnnum.templating.files import load_entry, save_entry

LEARN = 'name = "MINE"\n[design]\nmismatch = [0.01]\n[learn]\nlike = "EDGE"\nenough = 1e-3\n'


def made(tmp_path, text):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    assert is_spec(path)
    return designed(load_spec(path), Engine("numba"))


def test_a_template_is_learned_and_recorded_with_its_proof(tmp_path):
    (one,) = made(tmp_path, LEARN + "restarts = 12\n")
    template, proof = one.entry.template, one.entry.proof
    edge = get_template("EDGE")
    assert template.digest != edge.digest
    assert np.array_equal(template.A != 0, edge.A != 0)  # zeros of the pattern stay zeros
    assert len(np.unique(template.B)) == len(np.unique(edge.B))  # equal weights stay equal
    # the check draws other pictures than the lesson had, and knows no weight
    assert run_check(template, Engine("reference"), repeats=1).passed
    assert (proof.method, proof.digest) == ("gradients", template.digest)
    assert proof.examples == np.asarray(lesson_of(edge, ()).target).size
    assert [flip.mismatch for flip in proof.flips] == [0.01]
    save_entry(one.entry, tmp_path / "kept.toml")
    kept = load_entry(tmp_path / "kept.toml")
    assert kept.template.digest == template.digest
    assert kept.proof.method == "gradients"


def test_examples_are_the_lesson_where_there_are_some(tmp_path):
    rng, edge = np.random.default_rng(3), get_template("EDGE")
    pictures = np.where(rng.random((6, 8, 8)) > 0.3, 1.0, -1.0)
    answers = np.sign(Engine("reference").run(edge, input=pictures).output)

    def rows(picture):
        return ["".join("#" if cell > 0.0 else "o" for cell in row) for row in picture]

    text = LEARN + "restarts = 12\n"
    for picture, answer in zip(pictures, answers, strict=True):
        text += f"[[example]]\ninput = {rows(picture)}\noutput = {rows(answer)}\n"
    (one,) = made(tmp_path, text)
    found = Engine("reference").run(one.entry.template, input=pictures).output
    assert np.array_equal(np.sign(found), answers)
    assert one.entry.proof.examples == 6 * 64


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (LEARN.replace('like = "EDGE"\n', ""), "'learn.like' is missing"),
        (LEARN + "margin = 1\n", "unknown key 'margin'"),
        (LEARN + '[search]\nlike = "EDGE"\n', "keep one of them"),
        (LEARN + "restarts = 1\niterations = 1\n", "was not learned: the mean squared error"),
        (
            LEARN + '[[example]]\ninput = ["#o"]\noutput = ["#o"]\n'
            '[[example]]\ninput = ["#"]\noutput = ["#"]\n',
            "must have one size",
        ),
        (LEARN.replace("EDGE", "HOLE"), "duration"),
    ],
)
def test_what_cannot_be_learned_is_said(tmp_path, text, words):
    with pytest.raises(TemplateError, match=words):
        made(tmp_path, text)
