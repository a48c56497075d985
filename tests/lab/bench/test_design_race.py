"""Learning as celnn does it against ours: losses are celnn's own, and ours are no larger."""

import importlib.util

import pytest

from cnnum.lab.bench.peers.design_race import NEAR, DesignRun, measure_design


def test_ours_reaches_the_loss_of_the_peer():
    found = list(measure_design(quick=True))
    rows = [row for row in found if isinstance(row, DesignRun)]
    missing = [row for row in found if isinstance(row, str)]
    if not rows:
        assert all("pip install" in sentence for sentence in missing)
        pytest.skip(missing[0])
    for row in rows:
        assert row.error <= row.peer_error + 1e-9
        assert row.near_error <= max(row.error, NEAR) + 1e-9


def test_a_missing_library_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "deap", None)
    monkeypatch.setitem(__import__("sys").modules, "torch", None)
    if importlib.util.find_spec("celnn") is None:
        pytest.skip("celnn is not installed")
    found = list(measure_design(quick=True))
    assert len(found) == 2
    assert all("celnn" in str(one) and "pip install" in str(one) for one in found)
