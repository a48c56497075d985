"""Long runs keep no list: figures of as many frames as come stay within bounded memory."""

import gc
import logging
import math
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from cnnum.errors import FrameError
from cnnum.frame import Frame, Quality
from cnnum.scenes.bad_frames import PERSISTENT, SAID_EVERY, BadFrames
from cnnum.scenes.pipeline import Scene, load_scene
from cnnum.scenes.scene_record import Histogram

SCRIPT = [{"kind": "press", "load": 1.0, "duration": 0.1}]


@pytest.mark.parametrize("share", [0.5, 0.99, 1.0, 0.001])
def test_quantiles_are_within_a_hundredth(share):
    values = 10.0 ** np.random.default_rng(2).uniform(-9, 6, 20_000)
    histogram = Histogram()
    for value in values.tolist():
        histogram.add(value)
    exact = np.sort(values)[max(0, math.ceil(share * len(values)) - 1)]
    assert histogram.quantile(share) == pytest.approx(exact, rel=0.01)


def test_equal_numbers_have_their_own_quantile():
    histogram = Histogram()
    assert histogram.quantile(0.5) == 0.0
    for value in (0.25, 0.25, 0.25, 0.0, 1e9, math.inf):
        histogram.add(value)
    assert histogram.quantile(0.5) == 0.25
    assert histogram.quantile(1.0) == math.inf


def grown(scene: Scene, frames: int) -> int:
    """Bytes that a scene has more after all frames than after a tenth of them."""

    def endless() -> Iterator[Frame]:
        first = next(type(scene.driver).frames(scene.driver))
        wrong = replace(first, values=np.full_like(first.values, np.nan))
        for number in range(frames):
            kind = (wrong, replace(first, quality=Quality.REPEATED), first)[min(number % 100, 2)]
            yield replace(kind, time=number / 200.0)

    scene.driver.frames = endless
    seen, before = 0, 0
    tracemalloc.start()
    try:
        for moment in scene.results():
            seen += 1
            if moment.number == frames // 10:
                gc.collect()
                before = tracemalloc.get_traced_memory()[0]
        gc.collect()
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()


def test_a_long_run_keeps_nothing_a_frame(faults, caplog):
    """A run keeps nothing a frame: after 20,000 (in full 2,000,000) its memory has not grown."""
    caplog.set_level(logging.CRITICAL, "cnnum")  # pytest keeps every sentence that is logged
    frames = 2_000_000 if faults.full else 20_000
    for _ in faults.trials(short=1, full=1):
        scene = load_scene("contact", changes={"array.script": SCRIPT})
        # a list of numbers would hold 8 bytes a frame and more: 144,000 in all. A quarter of it:
        # the histogram of times holds a float of 24 bytes in each bin that a slow machine adds
        more = grown(scene, frames)
        if more >= 36_000 or scene.summary().handed_on != frames * 98 // 100:
            faults.lose(f"{more} bytes more, {scene.summary()}")


def test_bad_frames_are_named_now_and_then(caplog):
    now = 0.0
    bad = BadFrames(clock=lambda: now)
    named = []
    for number in range(100):
        now = number * SAID_EVERY / 40
        bad.add(number, number * 1e-3, FrameError("it is wrong."), good=number)
        if bad.named is not None and bad.named.frame == number:
            named.append((number, bad.named.count))
    assert named == [(0, 1), (40, 40), (80, 40)]
    said = [record.getMessage() for record in caplog.records]
    assert said[0] == "Frame 0 is bad and was skipped: it is wrong."
    assert said[1].startswith("40 more frames are bad and were skipped, the last of them frame 40")
    assert bad.count == 100


def taxels(*cells):
    error = FrameError("it is wrong")
    error.cells = cells
    return error


def test_a_taxel_is_bad_for_good_only_if_it_is_so_in_every_frame(caplog):
    bad = BadFrames(clock=lambda: 0.0)
    for number in range(50):  # a good frame between them
        bad.add(number, number * PERSISTENT / 10, taxels((1, 1)), good=number)
    for number in range(50):  # now one, now another
        bad.add(number, number * PERSISTENT / 10, taxels((number % 2, 1)), good=50)
    assert len(caplog.records) == 1
    for number in range(50):
        more = ((7, number),)
        bad.add(number, 100.0 + number * PERSISTENT / 10, taxels((1, 1), (2, 5), *more), good=51)
    assert len(caplog.records) == 2
    assert "'frames.dead = [[1, 1], [2, 5]]'" in caplog.records[1].getMessage()
