"""`cnnum calibrate`: a scan of known sensitivities gives them back, a wrong one a sentence."""

import json

import numpy as np
import pytest

from cnnum.tactile.halfspace import strain
from cnnum.tactile.taxel import Calibration
from cnnum.tactile.taxel.bridge import COMBINE

E, DEPTH, ALPHA_N, BETA = 0.87e6, 0.3e-3, 0.05, 1.46
HEADER = "x,y,fx,fy,fz,left,right,top,bottom"
FORCES = ((0.0, 0.0, 3e-3), (1e-3, 0.5e-3, 3e-3))


@pytest.fixture
def scan(tmp_path):
    """Upright and leaning loads over ±0.6 mm, read by an ideal taxel without noise."""
    rows = []
    for x in np.linspace(-0.6e-3, 0.6e-3, 13):
        for y in np.linspace(-0.6e-3, 0.6e-3, 13):
            for force in FORCES:
                e = strain(-x, -y, DEPTH, np.array(force), youngs_modulus=E)
                # (4.15) turned round: T_i = −ε_iz/α_s, S_n = −ε_zz/α_n
                signals = -e[:, 2] / (ALPHA_N * np.array([BETA, BETA, 1.0]))
                rows.append((x, y, *force, *(np.linalg.pinv(COMBINE) @ signals)))
    path = tmp_path / "scan.csv"
    np.savetxt(path, rows, delimiter=",", header=HEADER, comments="", fmt="%.17g")
    return path


def test_known_sensitivities_come_back(call, scan, tmp_path):
    out = tmp_path / "taxel.toml"
    done = call("calibrate", scan, "--youngs-modulus", E, "--out", out, "--json")
    assert done.exit_code == 0, done.output
    record = json.loads(done.stdout)
    # exact data: the search for the depth leaves 1e-6 of it
    assert record["depth"] == pytest.approx(DEPTH, rel=1e-4)
    assert record["alpha_normal"] == pytest.approx(ALPHA_N, rel=1e-3)
    assert record["beta_ns"] == pytest.approx(BETA, rel=1e-3)
    assert Calibration.load(out).beta_ns == pytest.approx(BETA, rel=1e-3)


def test_spikes_are_named_by_their_rows(call, scan, tmp_path):
    """1 V in three rows of 338; of exact data they are all that is off."""
    out, lines = tmp_path / "taxel.toml", scan.read_text().splitlines()
    for row in (17, 40, 300):
        numbers = lines[row].split(",")
        lines[row] = ",".join([*numbers[:5], str(float(numbers[5]) + 1.0), *numbers[6:]])
    scan.write_text("\n".join(lines) + "\n")
    options = ("--youngs-modulus", E, "--out", out)
    record = json.loads(call("calibrate", scan, *options, "--json").stdout)
    assert record["outliers"] == [17, 40, 300]
    assert record["alpha_normal"] == pytest.approx(ALPHA_N, rel=1e-3)
    out.unlink()
    assert "3, given little weight: rows 17, 40, 300" in call("calibrate", scan, *options).stdout


def test_scan_without_a_column_gets_one_sentence(call, tmp_path):
    path, out = tmp_path / "scan.csv", tmp_path / "taxel.toml"
    path.write_text(HEADER.replace("bottom", "below") + "\n" + ",".join("1" * 9) + "\n")
    done = call("calibrate", path, "--youngs-modulus", E, "--out", out)
    assert done.exit_code == 2
    assert "'bottom'" in done.stderr
    assert not out.exists()


def test_scan_that_shows_nothing_gets_one_sentence(call, tmp_path):
    path, out = tmp_path / "scan.csv", tmp_path / "taxel.toml"
    path.write_text(HEADER + "\n" + "\n".join(["0,0,0,0,0.003,1,1,1,1"] * 3) + "\n")
    done = call("calibrate", path, "--youngs-modulus", E, "--out", out)
    assert done.exit_code == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert not out.exists()
