"""`cnnum run --trace`: a page with every operation's result on one frame."""

import re
from html.parser import HTMLParser

import numpy as np

import cnnum
from cnnum import sqrt
from cnnum.report.run_pages import folds, write_trace_page


class _Cards(HTMLParser):
    def __init__(self):
        super().__init__()
        self.cards, self.pictures = 0, 0

    def handle_starttag(self, tag, attributes):
        self.cards += tag == "li"
        self.pictures += tag == "svg"


def test_trace_page_shows_every_operation(call, tmp_path):
    """By function, with memories that have names, folded arithmetic, and a search."""
    out = tmp_path / "trace.html"
    done = call(
        "run", "contact", "--frames", 100, "--trace", out, "--trace-frame", 90,
        "--set", "program.name=contact",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    page = _Cards()
    text = out.read_text()
    page.feed(text)
    assert page.cards > 20
    assert page.pictures > 5
    assert "gives contact" in text
    assert "loads_of <small>cnnum.templates.tactile.shared.loads" in text
    assert "memory touched</b>" in text
    assert "kept as memory touched" in text
    assert not re.search(r"memory \d", text)
    assert re.search(r"\d steps folded", text)
    assert "type='search'" in text
    assert "http" not in text


def test_the_trace_of_the_demo_is_small(tmp_path):
    """Under 3 MB with all that its program can run; it was 14.7 MB."""
    out = tmp_path / "trace.html"
    steps = cnnum.load_scene("demo", changes={"engine.name": "reference"}).trace(5)
    write_trace_page(out, "demo", steps)
    assert len(steps) > 400
    assert out.stat().st_size < 3e6


def test_only_arithmetic_that_one_step_of_the_same_function_reads_is_folded():
    def made(frame):
        raised = frame.a * 2.0 + 1.0
        shared = frame.a - 3.0
        return {"sum": sqrt(abs(raised)) + shared * 4.0, "shared": shared * shared}

    plan = cnnum.Engine("reference").compile(cnnum.program(made), shape=(3, 3), channels=("a",))
    steps = {step.number: step for step in plan.trace(np.ones((3, 3, 1)))}
    into = folds(tuple(steps.values()))
    names = sorted(steps[number].operation for number in into)
    assert names == ["absolute", "add", "multiply", "multiply", "root"]
    assert {steps[number].outputs for number in into.values()} == {("sum",)}


def test_frame_that_is_not_there_gets_one_sentence(call, tmp_path):
    out = tmp_path / "trace.html"
    done = call(
        "run", "contact", "--frames", 1, "--trace", out, "--trace-frame", 10**6,
        "--set", "program.name=contact",
    )  # fmt: skip
    assert done.exit_code == 2
    assert "no frame" in done.stderr
    assert not out.exists()
