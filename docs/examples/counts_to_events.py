"""From an array of counts to contact events in newtons, without a file."""

import tempfile
from pathlib import Path

import numpy as np

import cnnum

SCENE = """
needs = ["contact", "contact_map"]
[array]
driver = "npz"
path = "grip.npz"
[program]
name = "contact"
[program.parameters]
push = 1.0         # counts rise under a push
reads = "force"    # each taxel carries its own share of the load
[calibration]
gain = 0.02        # N a count
unit = "N"
tare = 20
"""

counts = np.random.default_rng(0).normal(16000.0, 3.0, (120, 4, 4, 3))
counts[60:, 1:3, 1:3, 2] += 300.0
with tempfile.TemporaryDirectory() as folder:
    cnnum.Recording(counts, rate=60.0, channels=("x", "y", "z")).save(f"{folder}/grip.npz")
    Path(folder, "scene.toml").write_text(SCENE)
    record = cnnum.load_scene(f"{folder}/scene.toml", engine=cnnum.Engine("numba")).collect()
print(record)
assert [event.kind for event in record.events] == ["contact"]
assert abs(record.events[0].strength - 24.0) < 1.0
assert record["contact_map"][-1].sum() == 4
