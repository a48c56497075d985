"""Values compare and hash by content; pickle and copy give them back, or say what to do."""

import copy
import pickle
import subprocess
import sys

import numpy as np
import pytest

import cnnum
from cnnum.errors import OtherProcessError


def template(name="leak", weight=0.5, **changes):
    return cnnum.Template(name, [[weight]], [[1.0]], duration=3.0, **changes)


def recording(last=1.0):
    values = np.zeros((3, 2, 2, 3))
    values[-1, 1, 0, 2] = last
    values[0, 0, 0, 0] = np.nan  # a bad frame is equal to its copy, too
    return cnnum.Recording(values, rate=10.0, truth={"contact": [0, 0, 1]})


def record(frames=5):
    return cnnum.load_scene("contact", changes={"array.rate": 50}).collect(frames=frames)


ENGINE = cnnum.Engine("reference")
VALUES = {
    "Template": (template, [template("other"), template(weight=0.6), template(z=0.1)]),
    "TemplateBatch": (
        lambda: cnnum.TemplateBatch(template(), A=[[[0.5]], [[0.6]]]),
        [cnnum.TemplateBatch(template(), A=[[[0.5]], [[0.7]]])],
    ),
    "Result": (
        lambda: ENGINE.run(template(), input=[[0.3]]),
        [ENGINE.run(template(), input=[[0.4]])],
    ),
    "Recording": (recording, [recording(2.0)]),
    "Frame": (lambda: next(recording().frames()), list(recording().frames())[1:]),
    "SceneRecord": (record, [record(4)]),
    "Analysis": (lambda: cnnum.analyse(template()), [cnnum.analyse(template(), (4, 4))]),
    "Chip": (lambda: cnnum.Chip(seed=3), [cnnum.Chip(seed=4)]),
    "Program": (lambda: cnnum.get_program("slip").bind(rate=100.0), [cnnum.get_program("slip")]),
}


@pytest.mark.parametrize("kind", VALUES)
def test_values_compare_hash_and_come_back(kind):
    make, others = VALUES[kind]
    one, again = make(), make()
    assert one is not again or kind == "Program"
    assert one == again
    assert hash(one) == hash(again)
    assert len({one, again}) == 1
    for came in (pickle.loads(pickle.dumps(one)), copy.copy(one), copy.deepcopy(one)):
        assert type(came) is type(one)
        assert came == one
        assert hash(came) == hash(one)
    for other in others:
        assert one != other
    assert one != 3


def test_every_part_of_a_template_counts():
    plain = template()
    changed = [
        template(boundary=1.0),
        template(input_boundary="zero-flux"),
        template(tau=2.0),
        template(initial=0.5),
        template(output="tanh"),
        cnnum.Template("leak", [[0.5]], [[1.0]], duration=4.0),
    ]
    assert len({plain, *changed}) == 1 + len(changed)
    assert plain == template(description="words change nothing", source="nor does a source")
    assert plain.digest == template("other").digest


def test_a_template_that_came_from_elsewhere_has_the_house_s_output():
    """Engines and proofs know the five output functions by identity."""
    for output in ("standard", "tanh", "sign"):
        came = pickle.loads(pickle.dumps(template(output=output)))
        assert came.output is template(output=output).output


def test_arrays_of_values_cannot_be_written():
    arrays = [template().A, recording().values, next(recording().frames()).values]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_arrays_of_the_caller_can_still_be_written():
    values = np.zeros((2, 2, 2, 3))
    held = cnnum.Recording(values, rate=10.0)
    values[0, 0, 0, 0] = 7.0  # no error: the recording made a view, and froze that alone
    assert not held.values.flags.writeable


def scene():
    return cnnum.load_scene("contact", changes={"array.rate": 50})


STAY = {
    "Engine": (lambda: ENGINE, r"cnnum\.Engine\('reference', precision='float64'\)"),
    "Plan": (lambda: scene().plan, "engine.compile"),
    "Stream": (lambda: scene().plan.stream(), "plan.stream"),
    "Scene": (scene, "cnnum.load_scene"),
}


@pytest.mark.parametrize("kind", STAY)
def test_what_holds_a_device_says_what_a_worker_does(kind):
    make, cure = STAY[kind]
    held = make()
    for way in (pickle.dumps, copy.copy, copy.deepcopy):
        with pytest.raises(OtherProcessError, match=cure) as error:
            way(held)
        assert isinstance(error.value, TypeError)
    assert len(repr(held)) <= 160


def test_a_program_inside_a_function_is_refused_by_name():
    @cnnum.program
    def hidden(frame):
        return {"load": frame.normal.sum()}

    with pytest.raises(OtherProcessError, match=r"'hidden'.*top of a module"):
        pickle.dumps(hidden)


def test_a_worker_runs_a_program_that_was_sent(tmp_path):
    """A process of its own, started anew: nothing comes with it but the bytes."""
    (tmp_path / "mine.py").write_text(
        "import cnnum\n\n\n@cnnum.program\ndef total(frame, gain=1.0):\n"
        "    return {'load': (frame.normal * gain).sum()}\n"
    )
    (tmp_path / "main.py").write_text(
        "import concurrent.futures, multiprocessing, numpy, cnnum, mine\n\n\n"
        "def work(program):\n"
        "    plan = cnnum.Engine('reference').compile(program, shape=(2, 2))\n"
        "    return float(plan(numpy.ones((2, 2, 3)))['load'])\n\n\n"
        "if __name__ == '__main__':\n"
        "    spawn = multiprocessing.get_context('spawn')\n"
        "    with concurrent.futures.ProcessPoolExecutor(1, mp_context=spawn) as pool:\n"
        "        print(pool.submit(work, mine.total.bind(gain=2.5)).result())\n"
    )
    done = subprocess.run(
        [sys.executable, "main.py"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "10.0"


@pytest.mark.parametrize("given", [{}, {"duration": "settle"}, {"at": [0.5, 1.0]}], ids=str)
def test_arrays_of_a_result_are_read_only_and_those_of_a_plan_are_the_callers(given):
    rng = np.random.default_rng(8)
    picture = rng.uniform(-1, 1, (3, 6, 7))
    for name in ("numba", "reference"):
        engine = cnnum.Engine(name)
        result = engine.run("EDGE", input=picture, **given)
        before = result.output.copy()
        for part in ("output", "state", "time", "steps", "settled", "error"):
            array = np.asarray(getattr(result, part))
            assert not array.flags.writeable, part
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0
        engine.run("EDGE", input=-picture, **given)
        np.testing.assert_array_equal(result.output, before)
        assert picture.flags.writeable


def test_what_a_plan_returns_is_kept_by_no_one_else():
    plan = cnnum.Engine("numba").compile("contact", (4, 4))
    frame = np.random.default_rng(9).uniform(0, 1, (4, 4, 3))
    first = plan(frame)
    kept = {name: np.copy(value) for name, value in first.items()}
    for value in first.values():
        np.asarray(value)[...] = 0
    for name, value in plan(frame).items():
        np.testing.assert_array_equal(value, kept[name])
