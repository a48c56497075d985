"""Pictures in another convention give a warning, and what is meant as it is given does not."""

import logging

import numpy as np
import pytest

import cnnum
from cnnum.arrays import as_shape
from cnnum.errors import ArrayError
from cnnum.runs.request import maps_by_role
from cnnum.templating.checks.registry import form_of
from cnnum.templating.library import template_names

RANDOM = np.random.default_rng(3)
ENGINE = cnnum.Engine("numba")
COLOURS = RANDOM.uniform(-1.0, 1.0, (20, 24, 3))
LEVELS = RANDOM.integers(0, 256, (20, 24, 3)).astype(np.uint8)
BINARY = np.where(RANDOM.random((9, 9)) < 0.4, 1.0, 0.0)
IMPULSE = np.zeros((9, 9))
IMPULSE[4, 4] = 1.0


def said(caplog, template, **maps):
    """What is said of a run, whether or not it was said before."""
    cnnum.errors.say_once.cache_clear()
    caplog.clear()
    roles = dict.fromkeys(("input", "previous", "state", "bias", "mask")) | maps
    with caplog.at_level(logging.WARNING, logger="cnnum"):
        maps_by_role(cnnum.get_template(template), roles)
    return " ".join(caplog.messages)


MISTAKES = {
    "colours": ("EDGE", {"input": COLOURS}, "batch of arrays of 24×3 cells"),
    "colours with alpha": ("EDGE", {"input": np.zeros((16, 16, 4))}, "arrays of 16×4 cells"),
    "colours from 0 to 1": ("HOLE", {"input": 0.5 + COLOURS / 2}, "20×24 with 3 channels"),
    "a film in colours": ("EDGE", {"input": np.zeros((2, 20, 24, 3))}, "24×3"),
    "colours as a state": ("AVERAGE", {"input": COLOURS}, "'state' of template 'AVERAGE'"),
    "mean of colours": ("EDGE", {"input": LEVELS.mean(axis=-1)}, "1 - levels / 127.5"),
    "resized levels": ("THRES", {"state": LEVELS[..., 0] * 0.99}, "1 - levels / 127.5"),
    "0 and 1": ("EDGE", {"input": BINARY}, "pass 2 * picture - 1"),
    "0 and 1 in single precision": ("EDGE", {"input": BINARY.astype(np.float32)}, "0 and 1"),
    "0 and 1 as a state": ("LOGAND", {"input": 2 * BINARY - 1, "state": BINARY}, "'state' of"),
    "one picture of two": ("LOGAND", {"input": 2 * BINARY - 1}, "starts at -1 in every cell"),
    "no markers": ("FIGREC", {"input": 2 * BINARY - 1}, "works on two pictures"),
    "one picture, begun from it": ("MATCNN_LOGAND", {"input": 2 * BINARY - 1}, "from its input"),
}
MEANT = {
    "a picture": ("EDGE", {"input": 2 * BINARY - 1}),
    "many frames of an array of 3 columns": ("EDGE", {"input": COLOURS[:, :12, :]}),
    "a few arrays of 3 columns": ("EDGE", {"input": COLOURS[:4]}),
    "three frames": ("EDGE", {"input": np.moveaxis(COLOURS, -1, 0)}),
    "one array of 3 columns": ("EDGE", {"input": COLOURS[0]}),
    "grey, from 0 to 1": ("EDGE", {"input": RANDOM.random((9, 9))}),
    "an impulse": ("EDGE", {"input": IMPULSE}),
    "0 and 1 for what stays grey": ("DIFFUS", {"input": BINARY}),
    "walls of 0 and 1": ("MATCNN_PATCHMC", {"input": BINARY, "state": 2 * BINARY - 1}),
    "counts of a linear template": ("smooth", {"input": 200.3 * RANDOM.random((9, 9))}),
    "two pictures": ("LOGAND", {"input": 2 * BINARY - 1, "state": 1 - 2 * BINARY}),
    "small numbers": ("EDGE", {"input": 100.5 * RANDOM.random((9, 9))}),
}


@pytest.mark.parametrize("what", MISTAKES)
def test_a_mistake_is_told_of_in_one_sentence(what, caplog):
    template, maps, hint = MISTAKES[what]
    assert hint in said(caplog, template, **maps)
    assert len(caplog.messages) == 1
    assert template in caplog.text


@pytest.mark.parametrize("what", MEANT)
def test_what_is_meant_so_is_not_told_of(what, caplog):
    template, maps = MEANT[what]
    assert said(caplog, template, **maps) == ""


def test_a_threshold_among_large_numbers_is_no_mistake(caplog):
    """A bias of −150 on a weight of 1 is a threshold of 150 newtons or counts."""
    cut = cnnum.Template("cut", A=[[0.5]], B=[[1.0]], z=-150.0)
    with caplog.at_level(logging.WARNING, logger="cnnum"):
        ENGINE.run(cut, input=200.3 * RANDOM.random((9, 9)))
    assert caplog.messages == []


def test_no_picture_of_the_librarys_own_checks_is_told_of(caplog):
    for name in template_names():
        template = cnnum.get_template(name)
        if template.check is None:
            continue
        case = form_of(template).cases(template, np.random.default_rng(1), as_shape((9, 9)))
        maps = {
            role: getattr(case, role, None)
            for role in ("input", "previous", "state", "bias", "mask")
        }
        assert said(caplog, name, **maps) == "", name


def test_runs_and_programs_say_it_once(caplog):
    with caplog.at_level(logging.WARNING, logger="cnnum"):
        for _ in range(3):
            ENGINE.run("LOGOR", input=2 * BINARY - 1)
        assert len(caplog.messages) == 1

        @cnnum.program
        def both(frame):
            return {"both": cnnum.apply("LOGDIF", input=frame.normal)}

        ENGINE.compile(both, shape=(4, 4))
    assert len(caplog.messages) == 2
    assert "LOGDIF" in caplog.messages[1]


def test_pixels_in_colours_are_refused_where_they_become_a_picture():
    for channels in (3, 4):
        with pytest.raises(ArrayError, match="looks like colours"):
            cnnum.as_picture(np.zeros((20, 24, channels), np.uint8))
    grey = cnnum.as_picture(np.rint(LEVELS[..., :3].mean(axis=-1)).astype(np.uint8))
    assert grey.shape == (20, 24)
    assert cnnum.as_picture(np.zeros((5, 24, 3), np.uint8)).shape == (5, 24, 3)
