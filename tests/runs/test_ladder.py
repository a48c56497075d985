"""Every way of the ladder is taken where it fits, and results name it; nothing below calls up."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cnnum
from cnnum.runs.ladder import LADDER
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.couplings import DelayedCoupling

ROOT = Path(__file__).parents[2]
X = np.random.default_rng(1).uniform(-1.0, 1.0, (4, 5))
CHAIN = np.zeros((2, 2, 1, 1))
CHAIN[1, 0] = 1.0  # a slow layer drives a fast one
STIFF = cnnum.Template("stiff", CHAIN, [[[[1.0]]], [[[0.0]]]], tau=(1.0, 1e-6), duration=2.0)
SMALL = cnnum.Template("small", np.full((3, 3), 0.05), [[0.2]], initial=0.0, duration=2.0)
DELAYED = cnnum.Template(
    "delayed", [[0.5]], [[1.0]], duration=2.0, initial=0.1,
    delayed=DelayedCoupling(0.4, [[[[-0.6]]]], [[[[0.2]]]]),
)  # fmt: skip
GROWING = cnnum.Template("growing", np.full((3, 3), 0.6), output="tanh", duration=8.0)
ALIKE = np.add.outer(*2 * (np.array([0.3, 0.1, 0.2, 0.2, 0.1, 0.3]),))
MIRRORED = cnnum.Template(  # what is symmetric decays, and what is not grows by e^{14}
    "mirrored", [[0.0, -10.0, 0.0], [-10.0, -10.0, -10.0], [0.0, -10.0, 0.0]],
    boundary="zero-flux", output="linear", duration=0.6,
)  # fmt: skip
CORNER = cnnum.get_template("CORNER")
BATCH = TemplateBatch.of([CORNER, replace(CORNER, z=-4.0)])

CASES = {
    "chip": ("EDGE", {"input": X, "chip": cnnum.Chip()}),
    "batch": (BATCH, {"input": X}),
    "times": ("HOLE", {"input": X, "state": X, "at": [0.5, 1.0]}),
    "decided": ("EDGE", {"input": np.sign(X), "method": "decision"}),
    "prepared": ("HOLE", {"input": X, "state": X, "duration": 2.0}),
    "wavefront": ("HOLE", {"input": np.sign(X)}),
    "compared": (GROWING, {"state": 1e-6 * X}),
    "settling": ("HOLE", {"input": X, "state": X, "duration": "settle"}),
    "symmetric": (MIRRORED, {"state": ALIKE, "method": "bogacki-shampine"}),
    "halved": (DELAYED, {"input": X}),
    "implicit": (STIFF, {"input": np.full((3, 3), 2.0)}),
    "linear": (SMALL, {"input": X}),
    "plain": ("HOLE", {"input": X, "state": X, "dt": 0.1, "duration": 1.0}),
}


@pytest.mark.parametrize("name", CASES)
def test_a_result_names_its_ways(fast, name):
    template, how = CASES[name]
    if name == "prepared":
        if fast.name != "opencl":
            pytest.skip("the engine has no quick way of single frames")
        assert "prepared" not in fast.run(template, **how).ways
    ways = fast.run(template, **how).ways
    assert name in ways
    order = [way.name for way in LADDER]
    assert sorted(ways, key=order.index) == list(ways)


def test_each_way_has_a_case():
    """ "checked" is the step from arrays to maps, and changes no result."""
    assert {way.name for way in LADDER} == CASES.keys() | {"checked"}
    assert all(way.reason for way in LADDER)


def test_nothing_calls_up():
    """Ways get those below as an argument: only the engine knows the ladder."""
    files = [*(ROOT / "cnnum").rglob("*.py")]
    users = [file for file in files if re.search(r"cnnum\.runs\.ladder", file.read_text())]
    assert [file.name for file in users] == ["engine.py"]
