"""The live page in a real browser: pictures move, events appear, time goes back, the line heals."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from foreign_files import press

from cnnum import load_recording
from cnnum.drivers.registry import open_driver
from cnnum.recordings.recording import Recording

from .browser import CHROMIUM, WAIT, Browser

pytest.importorskip("websockets")
if not CHROMIUM:
    pytest.skip("no Chromium is here", allow_module_level=True)

SHOTS = os.environ.get("CNNUM_SCREENSHOTS")
"""Folder that keeps the pictures of the page, for people to look at."""


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    page = Browser(tmp_path / "profile")
    yield page
    page.close()


class Viewing:
    """A running `cnnum view`, or another page."""

    def __init__(self, *arguments: str, page: str = "view") -> None:
        command = [sys.executable, "-m", "cnnum", page, "--json", *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.address: str = json.loads(self.process.stdout.readline())["address"]

    @property
    def port(self) -> str:
        return self.address.split(":")[2].split("/")[0]

    def stop(self) -> int:
        self.process.send_signal(signal.SIGTERM)  # SIGINT is ignored where a shell does so
        code = self.process.wait(WAIT)
        if self.process.stdout:
            self.process.stdout.close()
        return code


@pytest.fixture
def viewing() -> Iterator[Callable[..., Viewing]]:
    started: list[Viewing] = []

    def start(*arguments: str) -> Viewing:
        started.append(Viewing(*arguments))
        return started[-1]

    yield start
    for one in started:
        if one.process.poll() is None:
            one.stop()


def shot(browser: Browser, tmp_path: Path, name: str) -> bytes:
    return browser.picture((Path(SHOTS) if SHOTS else tmp_path) / f"{name}.png")


def canvas(browser: Browser) -> str:
    """The picture of the taxels, as one string."""
    return str(browser.value("document.getElementById('taxels').toDataURL()"))


def test_the_live_page(browser: Browser, viewing: Callable[..., Viewing], tmp_path: Path) -> None:
    server = viewing("demo", "--port", "0")
    browser.size(1300)
    browser.open(server.address)
    # frames move
    first = int(browser.until("document.body.dataset.number"))
    browser.until(f"Number(document.body.dataset.number) > {first + 20}")
    browser.until("document.querySelector('#contact.on') !== null")
    before = canvas(browser)
    browser.until("view.shown.load !== undefined && view.pictures > 60")
    assert canvas(browser) != before
    # an event appears, on the list and on the time line
    browser.until("document.querySelector('#events li[data-kind=contact]') !== null")
    browser.until("document.querySelector('#events li[data-kind=slip]') !== null")
    # why: the gauge of slip is beyond its level, and the one sentence says so
    browser.until("document.querySelector('#why [data-kind=slip].over') !== null")
    said = browser.value("document.querySelector('#why p').textContent")
    assert "slip is reported: the strength is" in said
    report = browser.value("view.why.reports.find((one) => one.kind === 'slip')")
    assert report["margin"] > 0.5  # a report goes on until half of its level
    assert report["margin"] == pytest.approx(report["strength"] / report["level"], rel=1e-6)
    width = browser.value("document.querySelector('#why .gauge i').style.width")
    now = browser.value("view.why.reports.find((one) => one.kind === 'slip').margin")
    assert 33.0 < float(width.rstrip("%")) <= 100.0  # logarithmic from 0.01 to 10 of the level
    assert now > 0.5
    assert browser.value("document.querySelectorAll('#why [data-kind=slip] dd').length") == 12
    shot(browser, tmp_path, "live-1300-light")
    # the last minute can be gone through
    browser.value("at('scrub').value = 985; at('scrub').dispatchEvent(new Event('input'))")
    held = browser.value("[view.held.time, view.newest.time]")
    assert 0.5 < held[1] - held[0] < 1.5
    browser.until(f"view.newest.time > {held[1] + 0.1}")
    assert browser.value("view.shown.time") == held[0]
    assert browser.value("document.body.dataset.held") == "yes"
    assert abs(browser.value("view.why.t") - held[0]) < 0.3  # the reasons are those of that time
    browser.value("at('live').click()")
    browser.until(f"view.shown.time > {held[1]}")
    # pause holds the picture, and lets go
    browser.value("at('pause').click()")
    paused = browser.value("view.shown.time")
    browser.until(f"view.newest.time > {paused}")
    assert browser.value("view.shown.time") == paused
    browser.value("at('pause').click()")
    assert browser.value("view.held") is None


def test_the_page_heals_when_its_server_comes_back(
    browser: Browser, viewing: Callable[..., Viewing]
) -> None:
    server = viewing("demo", "--port", "0")
    browser.size(400, 800)
    browser.open(server.address)
    browser.until("view.pictures > 5")
    assert server.stop() == 130
    browser.until("document.getElementById('link').dataset.state === 'lost'")
    seen = browser.value("view.pictures")
    viewing("demo", "--port", server.port)
    browser.until(
        f"document.getElementById('link').dataset.state === 'on' && view.pictures > {seen}"
    )


def test_a_recording_is_played_and_moved_in_time(
    browser: Browser, viewing: Callable[..., Viewing], recording: Path
) -> None:
    duration = load_recording(recording).times[-1]
    server = viewing(str(recording), "--port", "0")
    browser.size(1300, dark=True)
    browser.open(server.address)
    browser.until("view.pictures > 5 && view.hello.duration > 0")
    assert browser.value("view.hello.duration") == pytest.approx(duration, abs=0.01)
    assert browser.value("at('speed').hidden") is False
    browser.value("at('pause').click()")
    browser.value("at('scrub').value = 250; at('scrub').dispatchEvent(new Event('input'))")
    browser.until(f"Math.abs(view.shown.time - {0.25 * duration}) < 0.05")
    stays = browser.value("view.shown.number")
    assert browser.value("new Promise(r => setTimeout(() => r(view.shown.number), 300))") == stays
    browser.value("at('pause').click()")
    browser.until(f"view.shown.number > {stays + 10}")


PRESSED = "document.body.dispatchEvent(new KeyboardEvent('keydown', {key: 't', bubbles: true}))"


@pytest.mark.parametrize("tare", ["at('tare').click()", PRESSED], ids=["button", "key"])
def test_rest_is_learned_anew(
    browser: Browser, viewing: Callable[..., Viewing], tmp_path: Path, tare: str
) -> None:
    """An offset that stays is a contact until a tare."""
    import numpy as np

    t = np.arange(6000) / 100.0
    values = np.random.default_rng(3).normal(16_000.0, 3.0, (len(t), 4, 4, 3)).round()
    values[:, 1:3, 1:3, 2] += (300.0 * (t >= 1.0))[:, None, None]
    Recording(values, rate=100.0).save(tmp_path / "offset.npz")
    scene = tmp_path / "offset.toml"
    scene.write_text(
        'needs = ["contact"]\n[array]\ndriver = "npz"\npath = "offset.npz"\n[program]\n'
        'name = "contact"\n[program.parameters]\npush = 1.0\nreads = "force"\n'
    )
    server = viewing(str(scene), "--port", "0")
    browser.open(server.address)
    browser.until("document.querySelector('#contact.on') !== null")
    assert browser.value("at('why').hidden")  # nothing is said of slip where none is wanted
    browser.value(tare)
    browser.until("document.querySelector('#events li[data-kind=release]') !== null")
    browser.until("document.querySelector('#contact.on') === null")


@pytest.mark.parametrize("played", [True, False], ids=["recording", "scene"])
def test_warnings_and_a_silent_array_are_seen(
    browser: Browser, viewing: Callable[..., Viewing], tmp_path: Path, played: bool
) -> None:
    """A press shows Fortran's order, a column drops out, and then nothing moves any more."""
    import numpy as np

    values = np.round(press(4, 4, offset=16_000.0))
    values[230:260, :, 3] = 0.0
    values = values.transpose(0, 3, 2, 1).reshape(values.shape)
    values = np.concatenate([values, np.repeat(values[-1:], 250, axis=0)])
    path = Recording(values, rate=100.0).save(tmp_path / "press.npz")
    scene = tmp_path / "press.toml"
    scene.write_text(
        'needs = ["contact"]\n[array]\ndriver = "npz"\npath = "press.npz"\n[program]\n'
        'name = "contact"\n[program.parameters]\npush = 1.0\n[engine]\nname = "numba"\n'
    )
    asked = (str(path), "--scene", str(scene)) if played else (str(scene),)
    browser.open(viewing(*asked, "--port", "0").address)
    browser.until("document.querySelector('#events li[data-kind=silent]') !== null")
    browser.until("!at('warned').hidden && at('warnings').children.length >= 3")
    text = browser.value("at('warnings').textContent")
    assert text.count("frames channels cols rows") == 1
    assert "have dropped out" in text
    assert "read the same to the bit" in text


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short press and slip, as strain."""
    with open_driver("simulated", {"rate": 100.0}) as driver:
        frames = list(driver.frames())[:500]
        calibration: Any = driver.calibration  # type: ignore[attr-defined]
    import numpy as np

    strain = calibration.to_strain(np.stack([frame.values for frame in frames]))
    path = tmp_path_factory.mktemp("recording") / "press.npz"
    return Recording(strain, rate=100.0, unit="strain").save(path)


def test_the_page_fits_a_phone_and_a_desk(
    browser: Browser, viewing: Callable[..., Viewing], tmp_path: Path
) -> None:
    server = viewing("demo", "--port", "0")
    for width, dark in ((400, True), (1300, False), (1300, True), (400, False)):
        theme = "dark" if dark else "light"
        browser.size(width, dark=dark)
        browser.open(server.address)
        browser.until("document.querySelector('#events li[data-kind=slip]') !== null")
        assert browser.value("document.documentElement.dataset.theme") == theme
        assert browser.value("document.documentElement.scrollWidth <= innerWidth")
        assert len(shot(browser, tmp_path, f"page-{width}-{theme}")) > 10_000
    browser.value("at('theme').click()")
    assert browser.value("document.documentElement.dataset.theme") == "dark"


OWN = """
import cnnum

@cnnum.program
def own(frame):
    steep = 2.0 * frame.normal - frame.shear_x
    black = (steep > 0.5).picture()
    edge = cnnum.apply(cnnum.get_template("EDGE"), input=black)
    return {"steep": steep, "rim": edge.black(), "most": steep.max()}
"""


def test_the_studio_looks_into_a_program(browser: Browser, tmp_path: Path) -> None:
    """Results of steps are those of NumPy and SciPy, at the time that the slider says."""
    import numpy as np
    from scipy import ndimage

    values = np.round(np.random.default_rng(5).normal(size=(300, 6, 7, 3)), 3)
    Recording(values, rate=100.0).save(tmp_path / "own.npz")
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "own.toml").write_text(
        'needs = ["steep", "rim", "most"]\n[array]\ndriver = "npz"\npath = "own.npz"\n'
        '[program]\nname = "own.py:own"\n'
    )
    server = Viewing(str(tmp_path / "own.npz"), "--scene", str(tmp_path / "own.toml"), "--trust",
                     "--port", "0", page="studio")  # fmt: skip
    try:
        browser.size(1300, 2000)
        browser.open(server.address)
        browser.until("document.body.dataset.nodes && program.selected")
        for share in (250, 700):
            browser.value("view.paused || at('pause').click()")
            browser.value(f"at('scrub').value = {share}; "
                          "at('scrub').dispatchEvent(new Event('input'))")  # fmt: skip
            time = share / 1000.0 * browser.value("view.hello.duration")
            browser.until(f"Math.abs(view.shown.time - {time}) < 0.02")
            browser.until("program.time === view.shown.time")
            frame = values[browser.value("view.shown.number")]
            steep = 2.0 * frame[..., 2] - frame[..., 0]
            black = np.pad(steep > 0.5, 1, mode="edge")
            inner = ndimage.binary_erosion(black, np.ones((3, 3)))[1:-1, 1:-1]
            truth = {"steep": steep, "rim": black[1:-1, 1:-1] & ~inner, "most": steep.max()}
            for name, wanted in truth.items():
                number = browser.value(
                    f"program.shown.find((n) => n.outputs[0] === '{name}').number"
                )
                browser.value(f"program.values.clear(); asked = null; select({number})")
                browser.until(f"program.values.has({number})")
                shown = browser.value(f"[...program.values.get({number})]")
                np.testing.assert_allclose(shown, np.ravel(wanted), atol=1e-5, err_msg=name)
        # the walk: what gives the outline reads, through folded arithmetic, the steep picture
        browser.value("at('outputs').selectedIndex = 1; "
                      "at('outputs').dispatchEvent(new Event('change'))")  # fmt: skip
        assert "rim" in browser.value("at('said').textContent")
        browser.value("document.querySelector('#reads .node').click()")
        assert "EDGE" in browser.value("at('said').textContent")
        # only what is seen is sent
        assert browser.value("program.seen.size") < browser.value("program.nodes.length")
        for _ in range(3):  # a new line to the server knows nothing of what is seen
            browser.value("program.values.clear(); view.hello = null; view.socket.close()")
            browser.until("view.hello && program.values.size > 0")
        browser.size(400, 900, dark=True)
        assert browser.value("document.documentElement.scrollWidth <= innerWidth")
        shot(browser, tmp_path, "program-400-dark")
    finally:
        server.stop()


HAND = """
needs = ["contact", "slip", "twist"]
[array]
driver = "simulated"
shape = [4, 4]
rate = 100.0
script = [
    {kind = "hold", duration = 0.4},
    {kind = "press", duration = 0.3, load = 0.5},
    {kind = "pull", duration = 0.5, speed = 2e-3, direction = 0.3},
    {kind = "twist", duration = 0.4, angle = 0.5},
    {kind = "hold", duration = 60.0},
]
[program.parameters]
depth = 0.667
unit = 1.305
[skin.thumb]
[skin.index.array]
seed = 1
[skin.ring.array]
seed = 3
[skin.palm.array]
shape = [16, 16]
"""


def test_the_page_of_a_hand(
    browser: Browser, viewing: Callable[..., Viewing], tmp_path: Path
) -> None:
    """All skins are seen at once, and the chosen one as a scene alone is."""
    (tmp_path / "hand.toml").write_text(HAND)
    kept = tmp_path / "kept"
    kept.mkdir()
    server = viewing(str(tmp_path / "hand.toml"), "--record", str(kept), "--port", "0")
    browser.size(1300)
    browser.open(server.address)
    skins = ["thumb", "index", "ring", "palm"]
    shown = "[...document.querySelectorAll('#skins b')].map((name) => name.textContent)"
    browser.until(f"{shown}.length === 4")
    assert browser.value(shown) == skins
    # events name their skin, where a slip goes, and which way a twist turns
    lines = "[...document.querySelectorAll('#events li')].map((line) => line.textContent)"
    for name in skins:
        browser.until(f"{lines}.some((line) => line.startsWith('{name} contact'))")
        browser.until(f"{lines}.some((line) => line.startsWith('{name} ') && line.includes('°'))")
    browser.until(f"{lines}.some((line) => /twist .* from [xy] to [xy]/.test(line))")
    touched = "#skins [data-state=contact], #skins [data-state=twist]"
    browser.until(f"document.querySelectorAll('{touched}').length === 4")
    assert all(
        text.endswith(" ms")
        for text in browser.value(
            "[...document.querySelectorAll('#skins small')].map((late) => late.textContent)"
        )
    )
    # another skin is chosen; the plot is of the taxel under the pointer
    browser.value("document.querySelectorAll('#skins button')[3].click()")
    browser.until("view.hello.name === 'palm' && view.shown && view.shown.marks.length === 256")
    box = browser.value("(({left, top, width, height}) => [left, top, width, height])"
                        "(at('taxels').getBoundingClientRect())")  # fmt: skip
    x, y = box[0] + box[2] * 5.5 / 16, box[1] + box[3] * 7.5 / 16
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    browser.until(
        "!at('taxel').hidden && at('taxelSaid').textContent.startsWith('row 7, column 5')"
    )
    said = browser.value("[at('taxelNow').children[0].textContent, at('plot').toDataURL().length]")
    assert said[0].startswith("normal ")
    assert said[1] > browser.value(
        "(() => { const blank = document.createElement('canvas');"
        " blank.width = at('plot').width; blank.height = at('plot').height;"
        " return blank.toDataURL().length; })()"
    )
    # a tare lets go of all that is held; a recording has a file of each skin
    browser.value("at('record').click()")
    browser.until("view.recording === true")
    browser.value("at('tare').click()")
    for name in skins:
        browser.until(f"{lines}.some((line) => line.startsWith('{name} release'))")
    browser.value("at('record').click()")
    browser.until("at('recorded').textContent.includes(' frames in ')")
    files = sorted(path.stem.rpartition("-")[2] for path in kept.glob("*.mcap"))
    assert files == sorted(skins)
    assert load_recording(next(kept.glob("*-palm.mcap"))).values.shape[1:] == (16, 16, 4)
    for width, dark in ((1300, False), (400, True), (1300, True), (400, False)):
        theme = "dark" if dark else "light"
        browser.size(width, dark=dark)
        browser.value(f"theme('{theme}')")
        browser.until("view.dirty === false")
        assert browser.value("document.documentElement.scrollWidth <= innerWidth")
        shot(browser, tmp_path, f"hand-{width}-{theme}")
