"""Learning as celnn does it against ours: losses are celnn's own, and ours are no larger."""

import importlib.util
import sys

import pytest

from cnnum.cli import main
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
    monkeypatch.setitem(sys.modules, "deap", None)
    monkeypatch.setitem(sys.modules, "torch", None)
    if importlib.util.find_spec("celnn") is None:
        pytest.skip("celnn is not installed")
    found = list(measure_design(quick=True))
    assert len(found) == 2
    assert all("celnn" in str(one) and "pip install" in str(one) for one in found)


BROKEN = {
    "no such module": ({"__init__": ""}, "No module named 'deap.base'"),
    "one of several": ({"__init__": "", "base": "", "creator": ""}, "No module named 'deap.tools'"),
    "no library": (
        {"__init__": "", "base": "raise ImportError('libdeap.so: no such file')"},
        "libdeap.so: no such file",
    ),
    "of another Python": ({"__init__": "import imp_of_long_ago"}, "'imp_of_long_ago'"),
}


@pytest.mark.parametrize(("modules", "reason"), BROKEN.values(), ids=BROKEN)
def test_a_library_that_is_half_installed_ends_the_race(
    modules, reason, tmp_path, monkeypatch, capsys
):
    pytest.importorskip("celnn")
    package = tmp_path / "deap"
    package.mkdir()
    for name, text in modules.items():
        (package / f"{name}.py").write_text(text)
    for name in [name for name in sys.modules if name.partition(".")[0] == "deap"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(tmp_path)
    try:
        with pytest.raises(SystemExit) as ended:
            main(["bench", "design", "--quick"])
    finally:
        for name in [name for name in sys.modules if name.partition(".")[0] == "deap"]:
            del sys.modules[name]
    said = capsys.readouterr().err
    assert ended.value.code == 2
    assert said.count("\n") == 1
    assert "'deap'" in said
    assert reason in said
    assert "--force-reinstall" in said
