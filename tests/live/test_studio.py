"""The bench of templates: its numbers against closed forms, and the page in a real browser."""

import asyncio
import json
import os
import signal
import struct
import subprocess
import sys
import time
from base64 import b64encode
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import ndimage
from scipy.integrate import solve_ivp

import cnnum
from cnnum.cli.root import main
from cnnum.errors import TemplateError
from cnnum.live.feeds import PictureFeed
from cnnum.live.server import Place, listening, static
from cnnum.live.studio import FILES, NEIGHBOURHOODS, Studio, page_of, template_of
from cnnum.recordings.recording import Recording
from cnnum.templating.library import get_entry

from .browser import CHROMIUM, WAIT, Browser

pytest.importorskip("websockets")

UP = "ooo/o#o/.#."
"""Corners that point up: black below a black cell whose other upper neighbours are white."""

SHOTS = os.environ.get("CNNUM_SCREENSHOTS")
"""Folder that keeps the pictures of the page, for people to look at."""


@pytest.fixture(scope="module")
def studio() -> Studio:
    return Studio(Place(port=0), get_entry("CORNER"))


def drawn(picture: Any) -> dict[str, Any]:
    cells = np.round(100 * np.asarray(picture)).astype(np.int8)
    rows, cols = cells.shape
    return {"rows": rows, "cols": cols, "picture": b64encode(cells.tobytes()).decode()}


def answer(studio: Studio, kind: str, **parts: Any) -> Any:
    found = studio.reply(json.dumps({"do": kind, "id": 1, **parts}))
    if isinstance(found, str):
        return json.loads(found)
    (length,) = struct.unpack_from("<I", found)
    head = json.loads(found[4 : 4 + length])
    shape = len(head["times"]), head["rows"], head["cols"]
    return head, np.frombuffer(found, "<f4", offset=4 + length).reshape(shape)


def random_picture(side: int, seed: int = 0) -> Any:
    return np.where(np.random.default_rng(seed).random((side, side)) < 0.5, 1.0, -1.0)


def test_templates_of_the_library_pass_through_the_page_unchanged() -> None:
    shown = 0
    for name in cnnum.template_names():
        template = cnnum.get_template(name)
        try:
            page = json.loads(json.dumps(page_of(template)))
        except TemplateError:
            assert (
                max(template.layers, template.inputs, template.radius) > 1
                or not template.plain
                or template.output.name != "standard"
                or template.needs_state
            )
            continue
        again = template_of(page)
        for part in ("z", "tau", "boundary", "input_boundary", "initial", "duration"):
            assert np.array_equal(getattr(again, part), getattr(template, part)), (name, part)
        for part in ("A", "B"):
            short = getattr(template, part)
            whole = np.pad(short, [(0, 0), (0, 0), *2 * [((3 - short.shape[-1]) // 2,) * 2]])
            np.testing.assert_array_equal(getattr(again, part), whole if short.size else short)
        shown += 1
    assert shown > 100


@pytest.mark.parametrize("name", ["HOLE", "CORNER"])
def test_a_film_is_the_solution_of_the_equation(studio: Studio, name: str) -> None:
    """By SciPy, with every cell within 0.1 at every time: a front that comes late by 0.01 τ, of a
    step of 0.08 τ, changes states of the rate 10 so much."""
    template, picture = cnnum.get_template(name), random_picture(8)
    head, states = answer(studio, "run", template=page_of(template), **drawn(picture))

    def near(values: Any, kernel: Any, rim: float) -> Any:
        padded = np.pad(values, 1, constant_values=rim)
        return ndimage.correlate(padded, kernel, mode="constant")[1:-1, 1:-1]

    drive = near(picture, template.B[0, 0], template.input_boundary.constant) + template.z[0]

    def rates(_: float, x: Any) -> Any:
        x = x.reshape(8, 8)
        fed = near(np.clip(x, -1.0, 1.0), template.A[0, 0], template.boundary.constant)
        return (-x + fed + drive).ravel()

    start = np.full(64, float(template.initial))
    way = solve_ivp(rates, (0.0, head["times"][-1]), start, t_eval=head["times"], rtol=1e-8,
                    atol=1e-8, max_step=0.05)  # fmt: skip
    np.testing.assert_allclose(states.reshape(len(states), 64), way.y.T, atol=0.1)
    assert states.std() > 0.5
    # while a slider moves, the time that is shown is asked for alone
    for moment in (1, 7, 32):
        asked = {"template": page_of(template), "moment": moment, **drawn(picture)}
        short, two = answer(studio, "run", **asked)
        assert (short["times"], short["end"]) == ([0.0, head["times"][moment]], head["times"][-1])
        np.testing.assert_allclose(two, states[[0, moment]], atol=1e-4)
    assert "moments 1 to 32" in answer(studio, "run", **asked | {"moment": 33})["error"]


def test_a_film_of_64_by_64_cells_takes_less_than_50_ms(studio: Studio) -> None:
    """Of processor time, with numbers that are new each time; others may use the machine, too."""
    page, taken = page_of(cnnum.get_template("HOLE")), list[float]()
    for n in range(6):
        page["z"] = -1.0 + 0.01 * n
        begin = time.thread_time()
        answer(studio, "run", template=page, **drawn(random_picture(64)))
        taken.append(time.thread_time() - begin)
    assert np.median(taken[1:]) < 0.05  # the first one compiles


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("CORNER", {}),
        ("EDGE", {}),
        ("EDGE", {"initial": 0.4, "own": 3.0, "z": -0.3}),
        ("CORNER", {"initial": "input", "own": 2.25}),
    ],
)
def test_the_weakest_number_flips_the_nearest_neighbourhood_at_its_share(
    studio: Studio, name: str, changes: dict[str, Any]
) -> None:
    """The engine decides, with the number 1 % short of that share and 1 % beyond."""
    given = {key: value for key, value in changes.items() if key != "own"}
    page = page_of(cnnum.get_template(name)) | given | {"duration": 60.0}
    page["A"][1][1] = changes.get("own", page["A"][1][1])
    facts = answer(studio, "facts", template=page, **drawn(random_picture(8)))
    first = facts["nearest"][0]
    cells, share, weakest = np.array(first["cells"]), first["share"], first["weakest"]
    black = first["margin"] > 0.0
    for factor, flips in ((0.99, False), (1.01, True)):
        outcomes = list[bool]()
        for sign in (-1.0, 1.0):
            changed = json.loads(json.dumps(page))
            change = 1.0 + sign * factor * share
            if weakest == "z":
                changed["z"] *= change
            else:
                row, col = (int(number) for number in weakest[2:-1].split(","))
                changed["B"][row][col] *= change
            output = cnnum.Engine("numba").run(template_of(changed), input=cells).output
            outcomes.append(bool(output[1, 1] > 0.0) != black)
        assert any(outcomes) is flips


def test_flips_without_a_rule_are_those_of_512_neighbourhoods(studio: Studio) -> None:
    """A chip of 4,000 drawn here is wrong where a sum of mismatched weights has another sign."""
    template, width = cnnum.get_template("CORNER"), 0.08
    got = answer(studio, "flips", template=page_of(template), mismatch=width,
                 **drawn(random_picture(8)))  # fmt: skip
    numbers = np.append(template.B[0, 0].ravel(), template.z)
    seen = np.column_stack([NEIGHBOURHOODS.reshape(512, 9), np.ones(512)])
    rng = np.random.default_rng(7)
    chips = numbers * (1.0 + width * rng.normal(size=(4000, 10)))
    wrong = ((chips @ seen.T > 0.0) != (numbers @ seen.T > 0.0)).any(axis=1).mean()
    assert 0.05 < wrong < 0.95
    assert got["low"] <= wrong <= got["high"]
    # numbers of 3 bits are multiples of a third of the largest of B
    step = np.abs(template.B).max() / 3.0
    rounded = np.append(step * np.round(template.B[0, 0] / step), template.z)
    for share in (width, 0.0):
        got = answer(studio, "flips", template=page_of(template), mismatch=share, bits=3,
                     **drawn(random_picture(8)))  # fmt: skip
        chips = rounded * (1.0 + share * rng.normal(size=(4000, 10)))
        wrong = ((chips @ seen.T > 0.0) != (numbers @ seen.T > 0.0)).any(axis=1).mean()
        assert got["low"] <= wrong <= got["high"]
    still = answer(studio, "flips", template=page_of(template), mismatch=0.0,
                   **drawn(random_picture(8)))  # fmt: skip
    assert still["flipped"] == 0.0


def test_what_is_no_question_gets_a_sentence(studio: Studio) -> None:
    page = page_of(cnnum.get_template("EDGE"))
    assert "malformed" in json.loads(studio.reply("["))["error"]
    assert "malformed" in json.loads(studio.reply('{"do": "rm", "id": 1}'))["error"]
    assert "lacks" in answer(studio, "run")["error"]
    huge = {"rows": 1000, "cols": 1000, "picture": ""}
    assert "128×128" in answer(studio, "run", template=page, **huge)["error"]
    broken = page | {"A": [[1.0, 2.0]]}
    assert "k odd" in answer(studio, "run", template=broken, **drawn(random_picture(8)))["error"]
    long = page | {"duration": 1e9}
    assert "shorten" in answer(studio, "run", template=long, **drawn(random_picture(8)))["error"]
    assert "cannot be shown" in answer(studio, "load", name="RETINA_1")["error"]
    for number in ("Infinity", "1" + 400 * "0"):
        asked = f'{{"do": "save", "id": {number}, "template": []}}'
        assert set(json.loads(studio.reply(asked))) == {"do", "id", "error"}


@pytest.mark.parametrize("do", ["run", "facts", "flips", "compare"])
def test_what_is_no_template_or_too_large_is_refused_at_once(studio: Studio, do: str) -> None:
    """A coupling of 1e39 kept the facts of all later changes waiting for 12 s."""
    page = page_of(cnnum.get_template("EDGE"))
    coupled = [[0.0, 0.0, 0.0], [1e6, 1.0, 0.0], [0.0, 0.0, 0.0]]
    wide = np.eye(9).tolist()
    for template, said in {
        "list": ([], "lacks a part"),
        "number": (1, "lacks a part"),
        "digits": (page | {"z": 10**400}, "real numbers"),
        "coupled": (page | {"A": coupled}, "make its weights smaller"),
        "heavy": (page | {"B": (1e300 * np.ones((3, 3))).tolist()}, "the studio runs up to 1e+09"),
        "wide": (page | {"A": wide}, "couplings of 3×3 cells"),
        "name": (page | {"name": "<b>"}, "name of a template must be"),
    }.values():
        parts = {"template": template, "other": page, "mismatch": 0.05}
        assert said in answer(studio, do, **parts, **drawn(random_picture(8)))["error"]
    for wrong in ({"rows": float("inf")}, {"picture": 3}, {"cols": 10**400}):
        parts = {"template": page, **drawn(random_picture(8)), **wrong}
        assert do not in ("run", "facts") or "128×128" in answer(studio, do, **parts)["error"]


def test_a_page_of_another_origin_reaches_no_studio() -> None:
    from websockets.asyncio.client import connect
    from websockets.exceptions import InvalidStatus

    assert static("/", FILES)[0] == static("/studio.js", FILES)[0] == 200
    assert static("/view.js", FILES)[0] == static("/../studio.py", FILES)[0] == 404
    door = Studio(Place(port=0, token="s3cret"), get_entry("EDGE"))

    async def work() -> None:
        async with listening(door, "the studio") as (_, port):
            address = f"ws://127.0.0.1:{port}/studio"
            async with connect(f"{address}?token=s3cret", proxy=None) as page:
                assert json.loads(await page.recv())["template"]["name"] == "EDGE"
            for more in ({}, {"origin": "http://evil.example"}):
                with pytest.raises(InvalidStatus) as refused:
                    async with connect(address, proxy=None, **more):
                        pass
                assert refused.value.response.status_code == 403

    asyncio.run(asyncio.wait_for(work(), 60.0))


@pytest.fixture
def address() -> Iterator[str]:
    command = [sys.executable, "-m", "cnnum", "studio", "CORNER", "--json", "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    yield json.loads(process.stdout.readline())["address"]
    process.send_signal(signal.SIGTERM)
    process.wait(WAIT)
    process.stdout.close()


class Hand:
    """A mouse on the page."""

    def __init__(self, browser: Browser) -> None:
        self._browser = browser

    def place(self, element: str, x: float, y: float) -> tuple[float, float]:
        """Return where a share of an element's width and height lies on the screen."""
        script = f"""(() => {{ const e = {element}; e.scrollIntoView({{block: "center"}});
            const b = e.getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; }})()"""
        left, top, width, height = self._browser.value(script)
        return left + x * width, top + y * height

    def drag(self, element: str, *stops: tuple[float, float]) -> None:
        kinds = ["mousePressed", *["mouseMoved"] * (len(stops) - 1), "mouseReleased"]
        for kind, stop in zip(kinds, [*stops, stops[-1]], strict=True):
            x, y = self.place(element, *stop)
            self._browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left",
                               buttons=1, clickCount=1)  # fmt: skip


def shot(browser: Browser, tmp_path: Path, name: str) -> None:
    browser.value("scrollTo(0, 0)")
    assert len(browser.picture((Path(SHOTS) if SHOTS else tmp_path) / f"{name}.png")) > 10_000


def numbers(browser: Browser) -> dict[str, Any]:
    """Return what the page holds, once the film and the figures are those of its template."""
    browser.until(
        "!view.due && !Object.values(view.asked).some((k) => k.id) && view.film && view.facts"
    )
    return dict(browser.value(
        "({template: view.template, cell: view.cell, course: view.course, rests: view.rests, "
        "picture: [...view.picture].map((v) => v / 100), times: view.film.times, "
        "last: [...view.film.states.slice(-view.rows * view.cols)], facts: view.facts})"
    ))  # fmt: skip


@pytest.mark.skipif(not CHROMIUM, reason="no Chromium is here")
def test_from_an_idea_to_a_checked_template_in_the_page(address: str, tmp_path: Path) -> None:
    browser = Browser(tmp_path / "profile")
    try:
        browser.size(1300)
        browser.open(address)
        browser.until("view.film && view.facts && view.flips")
        hand = Hand(browser)
        _a_drag_changes_the_bias(browser, hand)
        _a_picture_is_loaded(browser, tmp_path)
        _a_stroke_draws(browser, hand)
        _a_rule_that_cannot_be_read_is_said(browser)
        _a_cell_obeys_its_equation(browser, hand)
        _corners_that_point_up(browser, hand, tmp_path)
        browser.size(400, dark=True)
        browser.value("dispatchEvent(new Event('resize'))")
        browser.until("document.documentElement.dataset.theme === 'dark'")
        assert browser.value("document.documentElement.scrollWidth <= innerWidth")
        shot(browser, tmp_path, "studio-400-dark")
    finally:
        browser.close()


@pytest.mark.skipif(not CHROMIUM, reason="no Chromium is here")
def test_an_array_is_the_picture_of_a_template(tmp_path: Path) -> None:
    """A recording with two corners pressed: the page shows them as it does pictures, and runs."""
    values = np.zeros((200, 9, 12, 3))
    values[40:, 2:5, 3:8, 2] = 4.0
    values[40:, 6, 10, 2] = 1.0
    Recording(values, rate=100.0).save(tmp_path / "own.npz")
    command = [sys.executable, "-m", "cnnum", "studio", "EDGE", "--json", "--port", "0"]
    live = ["--live", "npz", "--set", f"array.path={tmp_path / 'own.npz'}"]
    process = subprocess.Popen([*command, *live], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    browser = Browser(tmp_path / "profile")
    try:
        browser.size(1300, 1000)
        browser.open(json.loads(process.stdout.readline())["address"])
        browser.until("view.film && view.film.cols === 12 && view.picture[2 * 12 + 3] === 100")
        held = numbers(browser)
        wanted = -np.ones((9, 12))
        wanted[2:5, 3:8], wanted[6, 10] = 1.0, -0.5  # the largest load is black, no load white
        np.testing.assert_allclose(np.reshape(held["picture"], (9, 12)), wanted, atol=0.006)
        template = template_of(held["template"])
        output = cnnum.Engine("reference").run(template, input=wanted).output
        np.testing.assert_array_equal(np.reshape(held["last"], (9, 12)) > 0.0, output > 0.0)
        assert (output > 0.0).sum() == 13  # the rim of the block, and the lighter cell
        browser.value("at('live').click()")  # to draw again
        assert browser.value("at('live').checked") is False
        shot(browser, tmp_path, "studio-live")
    finally:
        browser.close()
        process.send_signal(signal.SIGTERM)
        process.wait(WAIT)
        process.stdout.close()


@pytest.mark.skipif(not CHROMIUM, reason="no Chromium is here")
def test_a_program_runs_on_what_is_drawn(tmp_path: Path) -> None:
    """Three strokes close a cell in; SciPy fills what the page then shows, and that alone."""
    command = [sys.executable, "-m", "cnnum", "studio", "holes", "--json", "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    browser = Browser(tmp_path / "profile")
    try:
        browser.size(1300, 1500)
        browser.open(json.loads(process.stdout.readline())["address"])
        browser.until("view.shown && program.selected")
        hand, before = Hand(browser), browser.value("view.newest.number")
        browser.value("at('clear').click()")
        browser.until(f"view.newest.number > {before}")
        stops = [(3, 3), (3, 9), (9, 9), (9, 3), (3, 3), (20, 3)]
        hand.drag("at('taxels')", *[((c + 0.5) / 32, (r + 0.5) / 32) for r, c in stops])
        wanted = -np.ones((32, 32))
        wanted[3:10, [3, 9]] = wanted[[3, 9], 3:10] = wanted[3:21, 3] = 1.0
        shown = "[...view.newest.loads.slice(-1024)].map((v) => 2 * v - 1)"
        drawn = json.dumps(wanted.astype(int).ravel().tolist(), separators=(",", ":"))
        browser.until(f"JSON.stringify({shown}) === '{drawn}'")
        filled = ndimage.binary_fill_holes(wanted > 0.0)
        truth = {"filled": filled, "holes": filled & (wanted < 0.0), "area": 25}
        for name, right in truth.items():
            number = browser.value(f"program.shown.find((n) => n.outputs[0] === '{name}').number")
            browser.value(f"program.values.clear(); asked = null; select({number})")
            browser.until(f"program.values.has({number}) && program.time === view.newest.time")
            got = browser.value(f"[...program.values.get({number})]")
            np.testing.assert_array_equal(np.array(got) > 0.0 if name != "area" else got,
                                          np.ravel(right), err_msg=name)  # fmt: skip
        number = browser.value("program.shown.find((n) => n.outputs[0] === 'holes').number")
        browser.value(f"select({number})")
        browser.until(f"program.values.has({number})")
        browser.value("at('again').click()")
        browser.until(f"{shown}.reduce((a, b) => a + b) === {25 - (1024 - 25)}")
        shot(browser, tmp_path, "studio-drawn")
        browser.size(400, dark=True)
        browser.until("document.documentElement.dataset.theme === 'dark'")
        assert browser.value("document.documentElement.scrollWidth <= innerWidth")
    finally:
        browser.close()
        process.send_signal(signal.SIGTERM)
        process.wait(WAIT)
        process.stdout.close()


def test_only_a_picture_of_the_right_size_is_taken() -> None:
    feed = PictureFeed("holes", {})
    feed.start()
    deadline = time.monotonic() + WAIT
    try:
        for wrong in ({}, {"picture": 3}, {"picture": "AAAA"}, {"picture": "!"}):
            feed.command(wrong)
        black = b64encode(np.full(1024, 127, np.int8).tobytes()).decode()
        while feed.hub.newest is None or feed.hub.newest.outputs["area"] != 0.0:
            assert time.monotonic() < deadline
            time.sleep(0.01)
            feed.command({"picture": black})
        assert (feed.hub.newest.frame.values == 1.0).all()
        assert not feed.hub.ended
    finally:
        feed.stop()
    with pytest.raises(cnnum.CnnumError, match="generations"):
        PictureFeed("life", {"generation": 3})
    done = CliRunner().invoke(main, ["studio", "life", "--set", "array.rate=3"])
    assert done.exit_code == 2
    assert "--set program.parameters.NAME=VALUE" in done.stderr


def _a_drag_changes_the_bias(browser: Browser, hand: Hand) -> None:
    """The slider of z; every cell then ends as the sign of its sum, which is known."""
    hand.drag("at('slider')", (0.25, 0.5), (0.4, 0.5), (0.55, 0.5), (0.65, 0.5))
    held = numbers(browser)
    page = held["template"]
    assert 1.0 < page["z"] < 5.0  # 0.65 of the way from −10 to 10, and the width of the thumb
    picture = np.reshape(held["picture"], (32, 32))
    padded = np.pad(picture, 1, constant_values=-1.0)
    total = ndimage.correlate(padded, np.array(page["B"]), mode="constant")[1:-1, 1:-1] + page["z"]
    clear = np.abs(total) > 0.05
    assert ((np.reshape(held["last"], (32, 32)) > 0.0) == (total > 0.0))[clear].all()
    # one step back is the bias of before
    browser.value("at('undo').click()")
    assert numbers(browser)["template"]["z"] == -5.0


def _a_picture_is_loaded(browser: Browser, tmp_path: Path) -> None:
    """A file of as many cells as the page's picture is shown cell by cell, and runs."""
    image = pytest.importorskip("PIL.Image")
    rows, cols = browser.value("[view.rows, view.cols]")
    levels = np.random.default_rng(4).integers(0, 256, (rows, cols)).astype(np.uint8)
    image.fromarray(levels).save(tmp_path / "own.png")
    browser.call("DOM.enable")
    root = browser.call("DOM.getDocument")["root"]["nodeId"]
    chosen = browser.call("DOM.querySelector", nodeId=root, selector="#file")["nodeId"]
    first = round(100.0 - 200.0 / 255.0 * float(levels[0, 0]))
    browser.call("DOM.setFileInputFiles", files=[str(tmp_path / "own.png")], nodeId=chosen)
    browser.until(f"view.picture[0] === {first} && view.picture.some((v) => Math.abs(v) < 99)")
    held = numbers(browser)
    wanted = 1.0 - levels / 127.5  # black is 1
    picture = np.reshape(held["picture"], levels.shape)
    np.testing.assert_allclose(picture, wanted, atol=0.0051)  # held in whole hundredths
    output = cnnum.Engine("reference").run(template_of(held["template"]), input=picture).output
    np.testing.assert_allclose(np.clip(np.reshape(held["last"], levels.shape), -1, 1), output,
                               atol=1e-3)  # fmt: skip
    browser.value("at('undo').click()")


def _a_rule_that_cannot_be_read_is_said(browser: Browser) -> None:
    """It leaves no count of wrong cells, and the next film does not take the sentence back."""
    write = "at('rule').value = '{}'; at('rule').dispatchEvent(new Event('change'))"
    browser.value(write.format("foo(c)"))
    browser.until("!view.due && !view.asked.facts.id && !view.facts")
    browser.value("askFilms(false)")
    browser.until("!view.asked.run.id")
    assert "foo(c)" in browser.value("at('said').textContent")
    assert browser.value("at('facts').textContent") == ""
    browser.value(write.format(""))
    numbers(browser)
    assert browser.value("at('said').textContent") == ""


def _a_stroke_draws(browser: Browser, hand: Hand) -> None:
    before = np.reshape(numbers(browser)["picture"], (32, 32))
    hand.drag("at('picture')", (0.5 / 32, 31.5 / 32), (5.5 / 32, 31.5 / 32), (9.5 / 32, 31.5 / 32))
    after = np.reshape(numbers(browser)["picture"], (32, 32))
    assert (before[31] == -1.0).all()
    assert (after[31, :10] == 1.0).all()
    np.testing.assert_array_equal(after[:31], before[:31])
    assert (after[31, 10:] == -1.0).all()
    browser.value("at('undo').click()")
    np.testing.assert_array_equal(np.reshape(numbers(browser)["picture"], (32, 32)), before)


def _a_cell_obeys_its_equation(browser: Browser, hand: Hand) -> None:
    """A white cell among white ones: x = w t to −1, and then towards w − 1, with w = 4 − 5 + … ."""
    hand.drag("at('film')", (31.5 / 32, 0.5 / 32), (31.5 / 32, 0.5 / 32))
    held = numbers(browser)
    assert held["cell"] == [0, 31]
    w = -4.0 + 8.0 - 5.0
    times = np.array(held["times"])
    bend = 1.0 / abs(w)
    exact = np.where(times < bend, w * times, (w - 1) + (-1 - (w - 1)) * np.exp(bend - times))
    np.testing.assert_allclose(held["course"], exact, atol=2e-3)
    assert held["rests"] == [{"x": w - 1.0, "stable": True}]
    browser.value("at('scrub').value = 8; at('scrub').dispatchEvent(new Event('input'))")
    assert browser.value("at('when').textContent") == f"t = {times[8]:.2f} τ"
    browser.value("at('scrub').value = 32; at('scrub').dispatchEvent(new Event('input'))")


def _corners_that_point_up(browser: Browser, hand: Hand, tmp_path: Path) -> None:
    shot(browser, tmp_path, "studio-1-begin")
    assert browser.value("at('hint').checkVisibility()")  # until there is a rule
    browser.value("at('name').value = 'up'; at('name').dispatchEvent(new Event('input'))")
    for n, sign in enumerate(UP.replace("/", "")):
        for _ in range({".": 0, "#": 1, "o": 2}[sign]):
            hand.drag(f"at('stencil').children[{n}]", (0.5, 0.5))
    numbers(browser)
    assert browser.value("at('rule').value") == f'match("{UP}")'
    assert browser.value("view.facts.wrong") > 0.0  # CORNER is not what is wanted
    assert not browser.value("at('hint').checkVisibility()")
    shot(browser, tmp_path, "studio-2-wanted")
    hand.drag("at('design')", (0.5, 0.5))
    browser.until("view.template.z !== -5 && view.facts && view.facts.wrong === 0 && view.flips")
    held = numbers(browser)
    picture = np.reshape(held["picture"], (32, 32)) > 0.0
    black = [[0, 0, 0], [0, 1, 0], [0, 1, 0]]
    white = [[1, 1, 1], [1, 0, 1], [0, 0, 0]]
    truth = ndimage.binary_hit_or_miss(np.pad(picture, 1), black, white)[1:-1, 1:-1]
    np.testing.assert_array_equal(np.reshape(held["last"], (32, 32)) > 0.0, truth)
    assert truth.any()
    browser.value("at('second').value = 'CORNER'; at('second').dispatchEvent(new Event('change'))")
    browser.until("at('unlike').textContent.includes('512')")
    unlike = int(browser.value("at('unlike').textContent").split()[2])
    ring = NEIGHBOURHOODS.sum(axis=(1, 2)) - NEIGHBOURHOODS[:, 1, 1]
    corner = 4.0 * NEIGHBOURHOODS[:, 1, 1] - ring - 5.0 > 0.0
    signs = np.array([{"#": 1.0, "o": -1.0, ".": 0.0}[s] for s in UP.replace("/", "")])
    points = NEIGHBOURHOODS.reshape(512, 9) @ signs == 7.0
    assert unlike == int((corner != points).sum())
    browser.value("at('mismatch').value = 10; at('mismatch').dispatchEvent(new Event('input'))")
    browser.until("view.flips && view.flips.of === 'the rule'")
    assert 0.0 <= browser.value("view.flips.low") < browser.value("view.flips.high") <= 1.0
    numbers(browser)
    shot(browser, tmp_path, "studio-3-found")
    browser.value("at('save').click()")
    toml = browser.until("view.saved")
    assert "cnnum templates check up.toml" in browser.value("at('said').textContent")
    (tmp_path / "up.toml").write_text(toml, encoding="utf-8")
    words = ["templates", "check", str(tmp_path / "up.toml"), "--engine", "numba", "--json"]
    checked = CliRunner().invoke(main, words)
    assert checked.exit_code == 0, checked.output
    records = [json.loads(line) for line in checked.stdout.splitlines()]
    assert all(record["passed"] for record in records if "passed" in record)
    template = cnnum.load_template(tmp_path / "up.toml")
    assert template.name == "up"
    assert dict(template.check.parameters if template.check else ()) == {"rule": f'match("{UP}")'}
