"""`cnnum run` and `cnnum replay` of uSkin trials that were not written to their ends."""

import warnings

import numpy as np
import pytest

from cnnum.cli.commands import devices
from cnnum.errors import RecordingWarning

ROWS = 60


@pytest.fixture
def trial(tmp_path):
    """Two pads in still air, and the labels of all rows but the last."""
    trial = tmp_path / "trial"
    trial.mkdir()
    header = ",".join(f"txl{n}_{axis}" for n in range(1, 17) for axis in "xyz")
    for pad in (1, 2):
        values = np.random.default_rng(pad).integers(16_000, 16_010, (ROWS, 48))
        lines = [header, *(",".join(map(str, row)) for row in values.tolist())]
        (trial / f"xela_sensor{pad}.csv").write_text("\n".join(lines) + "\n")
    labels = ["slip,fail", *["0.0,0.0"] * (ROWS - 1)]
    (trial / "slip_label.csv").write_text("\n".join(labels) + "\n")
    return trial


@pytest.mark.parametrize("command", ["run", "replay"])
def test_rows_left_out_are_said_in_a_sentence_and_counted(shell, records, trial, command):
    where = {
        "run": ("run", "uskin_grasp", "--set", f"array.path={trial}"),
        "replay": ("replay", trial, "--scene", "uskin_grasp"),
    }[command]
    done = shell(*where, "--set", "array.rate=60", "--engine", "numba", "--json")
    assert done.returncode == 0
    *_, line = done.stderr.splitlines()
    assert line == (
        f"cnnum: The files of '{trial}' end in different rows: {ROWS - 1} rows are read, and the "
        "last rows of the longer files are left out (1 of 'xela_sensor1.csv', "
        "1 of 'xela_sensor2.csv')."
    )
    *_, summary = records(done.stdout)
    assert (summary["frames"], summary["dropped"]) == (ROWS - 1, 1)


def test_folder_of_trials_is_wrong_input(shell, trial):
    done = shell("replay", trial.parent, "--set", "array.rate=60")
    assert done.returncode == 2
    *_, line = done.stderr.splitlines()  # without OpenCL it says so before
    assert "folder of 1 trial(s), not one: name one of them ('trial')" in line


def test_other_warnings_are_shown_as_ever(call, monkeypatch):
    shown = []
    monkeypatch.setattr(warnings, "showwarning", lambda *args: shown.append(args[1]))

    def warn(**_):
        warnings.simplefilter("always")
        warnings.warn("from elsewhere", RuntimeWarning, stacklevel=1)
        warnings.warn("of a recording", RecordingWarning, stacklevel=1)

    monkeypatch.setattr(devices.command, "callback", warn)
    result = call("devices")
    assert shown == [RuntimeWarning]
    assert result.stderr == "cnnum: of a recording\n"
