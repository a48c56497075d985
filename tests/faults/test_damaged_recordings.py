"""Recordings that are cut, flipped and overwritten anywhere: every whole chunk is given back."""

import random
from dataclasses import replace
from pathlib import Path

import numpy as np
from played_recordings import frames_in
from same_frames import same

from cnnum.frame import Frame, Quality, Truth
from cnnum.recordings.export import write_index
from cnnum.recordings.layout import Layout
from cnnum.recordings.mcap_chunks import ChunkMaker, beginning
from cnnum.recordings.reader import look


def small() -> tuple[bytes, list[tuple[int, int, list[Frame]]]]:
    """Return a recording of four chunks, and for each its begin, its end and its frames."""
    layout = Layout((1, 2), ("normal",), "V", 100.0, ("load",))
    maker, data, chunks = ChunkMaker(layout), beginning(), []
    for first in range(0, 16, 4):
        frames = [
            Frame(
                values=np.array([[[n + 0.1], [1.0 / (n + 1)]]]),
                channels=("normal",),
                unit="V",
                sequence=n,
                time=n / 100.0,
                quality=Quality(n % 2 * 4),
                truth=Truth({"load": n * 0.3}),
            )
            for n in range(first, first + 4)
        ]
        for frame in frames:
            maker.add(frame, 10**18 + frame.sequence)
        begin, index = len(data), 9 + 6 + 16 * len(frames)
        data += maker.end()
        chunks.append((begin, len(data) - index, frames))
    return data, chunks


def whole(path: Path) -> bytes:
    """Return the small recording with its index, by way of a file."""
    path.write_bytes(small()[0])
    with path.open("rb+") as file:
        write_index(file, look(path).layout)
    return path.read_bytes()


def test_cut(faults, tmp_path):
    """A recording that is cut at any byte gives back every chunk before the cut."""
    path, chunks = tmp_path / "cut.mcap", small()[1]
    data = whole(path)
    for cut in faults.each(range(len(data)), short=300):
        path.write_bytes(data[:cut])
        expected = [frame for _, end, frames in chunks if end <= cut for frame in frames]
        found = frames_in(path)
        if len(found) != len(expected) or not all(map(same, found, expected)):
            faults.lose(f"cut at {cut}: {len(found)} frames of {len(expected)}")


def test_flip(faults, tmp_path):
    """A flipped byte anywhere costs one chunk at most, and no other frame changes."""
    rng, path, chunks = random.Random(7), tmp_path / "flip.mcap", small()[1]
    data = whole(path)
    every = [frame for _, _, frames in chunks for frame in frames]
    for place in faults.each(range(len(data)), short=300):
        flipped = bytearray(data)
        flipped[place] ^= rng.randrange(1, 256)
        path.write_bytes(flipped)
        found = {frame.sequence: frame for frame in frames_in(path)}
        lost = [frame.sequence for frame in every if frame.sequence not in found]
        after = found.get(lost[-1] + 1) if lost and lost[0] > 0 else None
        if after is not None:  # it says that scans before it are missing, and is as it was else
            if not after.quality & Quality.DROPPED_BEFORE:
                faults.lose(f"flip at {place}: no flag at {after.sequence}")
            plain = Quality(after.quality & ~Quality.DROPPED_BEFORE)
            found[after.sequence] = replace(after, quality=plain)
        kept = [frame for frame in every if frame.sequence in found]
        if len(lost) not in (0, 4) or not all(same(found[f.sequence], f) for f in kept):
            faults.lose(f"flip at {place}: {lost}")


def test_garbage(faults, tmp_path):
    """Stretches that are overwritten, cut out or put in cost the chunks that they touch alone."""
    rng, path, (_, chunks) = random.Random(8), tmp_path / "torn.mcap", small()
    data = whole(path)
    for trial in faults.trials(short=100, full=2000):
        start = rng.randrange(len(data))
        size = rng.choice([1, 7, 60, 400, 2000])
        noise = rng.choice([bytes(size), rng.randbytes(size), b"\x06" * size, data[:size]])
        end = min(len(data), start + (0 if trial % 3 == 0 else size))
        path.write_bytes(data[:start] + (b"" if trial % 3 == 1 else noise) + data[end:])
        found = {frame.sequence for frame in frames_in(path)}
        for begin, stop, frames in chunks:
            untouched = stop <= start or begin >= end
            if untouched and not all(frame.sequence in found for frame in frames):
                faults.lose(f"trial {trial}: chunk at {begin}, {size} bytes from {start}")
