"""`cnnum run --trace`: a page with every operation's result on one frame."""

from html.parser import HTMLParser


class _Cards(HTMLParser):
    def __init__(self):
        super().__init__()
        self.cards, self.pictures = 0, 0

    def handle_starttag(self, tag, attributes):
        self.cards += tag == "li"
        self.pictures += tag == "svg"


def test_trace_page_shows_every_operation(call, tmp_path):
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
    assert "http" not in text


def test_frame_that_is_not_there_gets_one_sentence(call, tmp_path):
    out = tmp_path / "trace.html"
    done = call(
        "run", "contact", "--frames", 1, "--trace", out, "--trace-frame", 10**6,
        "--set", "program.name=contact",
    )  # fmt: skip
    assert done.exit_code == 2
    assert "no frame" in done.stderr
    assert not out.exists()
