"""The library goes out to other formats and comes back with all that comments can carry."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import cnnum
from cnnum.cli import main
from cnnum.design.designing import Spec, designed
from cnnum.errors import NotSupportedError, TemplateError
from cnnum.templating.files import load_entry, save_entry
from cnnum.templating.files.toml_format import TOML
from cnnum.templating.library import get_entry, template_names

NOT_CARRIED = {"nonlinear"}
"""A coupling that may come back as another product of weights and function, an equal one: each
format's tests hold it."""


ENGINE = cnnum.Engine("numba", precision="float64")


def trimmed(value):
    """A table whose matrices have no rim of zeros: files may widen them to the radius."""
    if isinstance(value, dict):
        return {key: trimmed(one) for key, one in value.items()}
    if not isinstance(value, list):
        return value
    matrix = np.array(value, dtype=object)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or len(matrix) % 2 == 0:
        return [trimmed(one) for one in value]
    while len(matrix) > 1 and not (matrix[[0, -1]].any() or matrix[:, [0, -1]].any()):
        matrix = matrix[1:-1, 1:-1]
    return matrix.tolist()


@pytest.mark.parametrize(("suffix", "least"), [(".tem", 230), (".m", 180), (".cnnsim", 140)])
def test_the_whole_library_comes_back_the_same(tmp_path, suffix, least):
    back, other = 0, []
    for name in template_names():
        entry, path = get_entry(name), tmp_path / f"t{suffix}"
        try:
            save_entry(entry, path, force=True)
        except NotSupportedError:  # its numbers have no place in such a file
            continue
        again = load_entry(path)
        if again.template.digest != entry.template.digest:
            # matrices with a rim of zeros are not the numbers that were measured
            assert again.measured is again.proof is None
            entry = replace(entry, measured=None, proof=None)
        texts = [TOML.write(one) for one in (entry, again)]
        if texts[0] != texts[1]:
            own, there = (trimmed(tomllib.loads(text)) for text in texts)
            for key in own.keys() - NOT_CARRIED:
                assert own[key] == there[key], (name, key)
            assert own.keys() - NOT_CARRIED == there.keys() - NOT_CARRIED, name
        assert all(guess.always for guess in again.guesses), (name, again.guesses)
        if again.template.digest != entry.template.digest:
            other.append((entry.template, again.template))
        back += 1
    assert back >= least
    for first, second in other:  # the numbers of all others are the same to the last bit
        np.testing.assert_allclose(picture_of(second), picture_of(first), atol=1e-9, err_msg=name)


def test_figures_and_proofs_stay_with_their_numbers(tmp_path):
    """What is changed by hand is no longer what was measured or proven."""
    (made,) = designed(Spec("lone", rule="c and ring == 0", mismatch=()), ENGINE)
    figures = get_entry("EDGE").measured
    entry = replace(made.entry, measured=replace(figures, digest=made.entry.template.digest))
    path = tmp_path / "lone.m"
    save_entry(entry, path)
    again = load_entry(path)
    assert again.measured == entry.measured
    assert TOML.write(again) == TOML.write(entry)
    assert "worst_case = 0.0" in TOML.write(again)
    text = path.read_text()
    bias = f"{entry.template.z[0]:g}"
    assert text.count(f"I = {bias}") + text.count(f"I={bias}") == 1, text
    path.write_text(text.replace(f"I = {bias}", "I = -20").replace(f"I={bias}", "I=-20"))
    changed = load_entry(path)
    assert changed.template.z[0] == -20.0
    assert changed.measured is changed.proof is None


def picture_of(template):
    """The output of a run on random gray pictures, which is as long as it takes no time."""
    random = np.random.default_rng(1)
    maps = {"state": random.uniform(-1.0, 1.0, (template.layers, 6, 6))}
    if template.inputs:
        maps["input"] = random.uniform(-1.0, 1.0, (template.inputs, 6, 6))
    given = {key: value[0] if len(value) == 1 else value for key, value in maps.items()}
    method = {} if template.output.discrete else {"method": "heun", "dt": 0.02}
    duration = 2.0 if template.duration == "settle" else min(template.duration, 2.0)
    return ENGINE.run(template, **given, duration=duration, **method).output


def test_other_programs_still_read_the_numbers(tmp_path):
    """The comments begin with the sign that all three formats leave out."""
    for suffix in (".tem", ".m", ".cnnsim"):
        path = tmp_path / f"hole{suffix}"
        save_entry(get_entry("HOLE"), path)
        added = [line for line in path.read_text().splitlines() if "cnnum:" in line]
        assert added
        assert all(line.startswith("% cnnum: ") for line in added)
    runs = cnnum.load_template(tmp_path / "hole.cnnsim")
    assert (runs.boundary, runs.initial, runs.duration) == (
        cnnum.get_template("HOLE").boundary,
        1.0,
        "settle",
    )


def test_the_command_says_what_others_will_not_see(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = CliRunner().invoke(main, ["templates", "export", "HOLE", "hole.m"])
    assert said.exit_code == 0
    assert (
        "Other programs will not see its boundary, input_boundary, initial, duration"
        in said.stdout.replace("\n", " ")
    )


def test_a_comment_that_is_no_value_is_refused(tmp_path):
    path = tmp_path / "hole.m"
    save_entry(get_entry("HOLE"), path)
    path.write_text(path.read_text() + "% cnnum: duration = [\n")
    with pytest.raises(TemplateError, match="duration"):
        load_entry(path)
