"""The gallery's templates that run in its page, in a real browser."""

import json
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import cnnum
from cnnum.cli import main

from .browser import CHROMIUM, Browser

pytest.importorskip("websockets")
if not CHROMIUM or find_spec("ziglang") is None:
    pytest.skip("needs Chromium and Zig", allow_module_level=True)


def test_a_drawn_picture_gives_the_edges_of_it(tmp_path: Path) -> None:
    page = tmp_path / "gallery.html"
    result = CliRunner().invoke(
        main, ["templates", "gallery", "EDGE", "--live", "--out", str(page)]
    )
    assert result.exit_code == 0, result.output
    browser = Browser(tmp_path / "profile")
    try:
        browser.open(page.as_uri())
        browser.value("document.querySelector('.live').open = true")
        browser.until("view.running.size === 1")
        browser.value("window.ran = [...view.running.values()][0]; 0")
        assert browser.value("ran.code.vector()") == 0  # to the bit, as the emulator
        browser.value("document.querySelector('.live').scrollIntoView()")
        before = json.loads(browser.value("JSON.stringify(Array.from(ran.maps[0]))"))
        box = browser.value(
            "(b => [b.left, b.top, b.width])"
            "(document.querySelector('.live canvas').getBoundingClientRect())"
        )
        row, col = 5, 9
        mouse = {"x": box[0] + box[2] * (col + 0.5) / 16, "y": box[1] + box[2] * (row + 0.5) / 16}
        browser.call(
            "Input.dispatchMouseEvent", type="mousePressed", button="left", clickCount=1, **mouse
        )
        browser.until(f"ran.maps[0][{16 * row + col}] !== {before[16 * row + col]}")
        drawn = np.array(json.loads(browser.value("JSON.stringify(Array.from(ran.maps[0]))")))
        answer = np.array(json.loads(browser.value("JSON.stringify(Array.from(ran.answer))")))
        asked = browser.value(
            "performance.getEntriesByType('resource')"
            ".filter(entry => !entry.name.startsWith('data:')).length"
        )
    finally:
        browser.close()
    assert np.flatnonzero(drawn != before).tolist() == [16 * row + col]
    picture = np.sign(drawn.reshape(16, 16)).astype(float)
    wanted = cnnum.Engine("reference").run("EDGE", input=picture).output
    np.testing.assert_array_equal(np.sign(answer.reshape(16, 16)), np.sign(wanted))
    assert asked == 0
