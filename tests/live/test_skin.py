"""The skin on the first page, in a real browser: a press is contact there and nowhere else."""

import re
from pathlib import Path

import pytest

from .browser import CHROMIUM, Browser

pytest.importorskip("websockets")
if not CHROMIUM:
    pytest.skip("no Chromium is here", allow_module_level=True)

PAGE = Path(__file__).parents[2] / "docs" / "skin.html"


def test_a_press_of_the_skin_is_contact(tmp_path: Path) -> None:
    browser = Browser(tmp_path / "profile")
    try:
        browser.open(PAGE.as_uri())
        browser.until("view.frames > 60")
        assert browser.value("code.vector()") == 0  # to the bit, as the emulator
        assert browser.value("view.touched || view.map.some(cell => cell)") is False
        for row, col in ((2, 5), (6, 1)):
            mouse = {"x": 40 * (col + 0.5), "y": 40 * (row + 0.5), "button": "left"}
            browser.call("Input.dispatchMouseEvent", type="mousePressed", clickCount=1, **mouse)
            browser.until(f"view.touched && view.map[{8 * row + col}] === 1")
            cells = browser.value("Array.from(view.map)")
            # the finger has a strain of a hundredth of its middle's at 3.4 taxels
            far = [n for n, cell in enumerate(cells) if cell and abs(n // 8 - row) > 4]
            assert not far
            assert (
                browser.value("document.getElementById('said').textContent")[:11] == "contact of "
            )
            browser.call("Input.dispatchMouseEvent", type="mouseReleased", clickCount=1, **mouse)
            browser.until("!view.touched")
        asked = browser.value("performance.getEntriesByType('resource').length")
    finally:
        browser.close()
    assert asked == 0  # nothing from elsewhere
    assert not re.search(r"(src|href)=|https?:", PAGE.read_text())
