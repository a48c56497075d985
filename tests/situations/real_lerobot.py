"""A data set of 100 episodes, read by LeRobot itself: `make lerobot`.

LeRobot brings some gigabytes and wants Python 3.12, so that it has an environment of its own. This
script writes the set; run by that environment's Python, with the folder as its argument, it reads
it. What was written stands next to the set in an archive of NumPy.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

EPISODES = 100


def write(folder: Path) -> None:
    """Write the set in four parts, the later ones appended."""
    from cnnum.recordings.lerobot import Episode, write_lerobot
    from cnnum.recordings.recording import Recording

    rng, episodes, known = np.random.default_rng(0), [], {}
    for number in range(EPISODES):
        count = int(rng.integers(100, 300))
        times = np.cumsum(rng.uniform(0.8, 1.2, count)) / 150.0
        touch = Recording(rng.integers(0, 4096, (count, 4, 4, 3)), times=times)
        at = np.arange(0.0, 4.0, 0.01)
        states = {
            "observation.state": (at, {"a": np.sin(at), "b": at}),
            "action": (at, {"a": number + at}),
        }
        events = {"slip": rng.uniform(0.0, times[-1] - times[0], 3).tolist(), "twist": []}
        episodes.append(Episode(touch, f"task {number % 7}", states, events))
        known[str(number)] = touch.values.astype(np.float32)
    np.savez(folder.with_suffix(".npz"), **known)
    for part in range(0, EPISODES, 25):
        write_lerobot(episodes[part : part + 25], folder, 30.0, append=part > 0)


def read(folder: Path) -> None:
    """Hold what LeRobot reads against what was written."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    known = np.load(folder.with_suffix(".npz"))
    whole = LeRobotDataset("local/set", root=folder)
    assert whole.num_episodes == EPISODES, whole.num_episodes
    taxels: dict[int, list[np.ndarray]] = {}
    slips: dict[int, int] = {}
    for row in (whole[place] for place in range(len(whole))):
        episode, new = int(row["episode_index"]), int(row["observation.tactile_new"])
        taxels.setdefault(episode, []).extend(row["observation.tactile"].numpy()[-new:][:new])
        slips[episode] = slips.get(episode, 0) + int(row["observation.tactile_events"][0])
        assert row["task"] == f"task {episode % 7}"
        at = float(row["timestamp"])
        assert abs(float(row["action"]) - episode - at) < 0.0101, (float(row["action"]), at)
    for number in range(EPISODES):
        np.testing.assert_array_equal(np.array(taxels[number]), known[str(number)])
        assert slips[number] == 3
    some = LeRobotDataset("local/set", root=folder, episodes=[3, 70])
    assert some.num_episodes == 2
    mean = whole.meta.stats["observation.tactile"]["mean"]
    windows = np.stack([whole[place]["observation.tactile"].numpy() for place in range(len(whole))])
    np.testing.assert_allclose(mean, windows.mean(axis=0, dtype=float), rtol=1e-6)
    print(f"LeRobot read {EPISODES} episodes, {len(whole)} rows: all frames, tasks and events")


if __name__ == "__main__":
    if sys.argv[1] != "--with":
        read(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch) / "set"
            write(folder)
            command = [sys.argv[2], __file__, str(folder)]
            offline = os.environ | {"HF_HUB_OFFLINE": "1"}
            sys.exit(subprocess.run(command, env=offline, check=False).returncode)
