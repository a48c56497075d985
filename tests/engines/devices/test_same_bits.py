"""Results have the same bits in every process, on any number of threads."""

import subprocess
import sys

import numpy as np
import pytest

from cnnum.engines.devices.selection import working_devices

DEVICES = [device.label for device in working_devices()]

CHILD = """
import sys
import numpy as np
import cnnum
rng = np.random.default_rng(0)
frames, large = rng.normal(0.0, 0.3, (40, 8, 8, 3)), rng.uniform(-1.0, 1.0, (300, 300))
name, device, file = sys.argv[1:]
engine = cnnum.Engine(name, device=device or None)
edge = engine.run(cnnum.get_template("EDGE"), input=large, duration=1.0)
slip = engine.compile(cnnum.get_program("slip"), (8, 8))(frames)
np.savez(file, state=edge.state, error=edge.error, **slip)
"""
"""Adaptive steps of an array that all cores share, and a program on a batch."""


@pytest.mark.parametrize(
    ("name", "device"), [*(("opencl", label) for label in DEVICES), ("numba", "")]
)
def test_processes_give_the_same_bits(name, device, tmp_path):
    kept = []
    for number in range(2):
        file = tmp_path / f"{number}.npz"
        subprocess.run([sys.executable, "-c", CHILD, name, device, file], check=True)
        with np.load(file) as found:
            kept.append({key: found[key] for key in found.files})
    assert np.ptp(kept[0]["state"]) > 1.0
    for key, values in kept[0].items():
        np.testing.assert_array_equal(kept[1][key], values, err_msg=key)
