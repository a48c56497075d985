"""The page: whole, alone, and with no figure that is not in the record."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cnnum.errors import ReportError
from cnnum.report import SceneRecord, write_demo_report
from cnnum.report.record import ReportData, to_json
from cnnum.report.sections import page
from cnnum.scenes.events import Event

VOID = {"meta", "input", "br", "img", "link", "hr"}
SECTIONS = ("story", "frames", "events", "errors", "plans", "latency", "further")


class Reader(HTMLParser):
    """Follows the tags, and gathers tables, text and the references of elements."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.references: list[str] = []
        self.sections: list[str] = []
        self.ids: list[str] = []
        self.rows: list[tuple[str, list[str]]] = []
        self.text: dict[str, str] = {}
        self.labels: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        known = dict(attrs)
        assert len(known) == len(attrs), f"an attribute twice in {tag}"
        self.references += [f"{k}={v}" for k, v in attrs if k in ("src", "href", "srcset", "data")]
        self.ids += [v for k, v in attrs if k == "id" and v]
        if tag == "section":
            self.sections.append(known.get("id") or "")
        if tag == "tr":
            self.rows.append((known.get("class") or "", []))
        if tag in ("td", "th"):
            self.rows[-1][1].append("")
        if known.get("aria-label"):
            self.labels.append(known["aria-label"] or "")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        where = self.open[-1] if self.open else ""
        self.text[where] = self.text.get(where, "") + data
        if "td" in self.open or "th" in self.open:
            self.rows[-1][1][-1] += f" {data}"

    def row(self, *starts: str) -> list[str]:
        """Return the row whose first cells begin so."""
        (found,) = (
            [cell.strip() for cell in cells]
            for _, cells in self.rows
            if all(c.strip().startswith(s) for c, s in zip(cells, starts, strict=False))
        )
        return found


def read(text: str) -> Reader:
    reader = Reader()
    reader.feed(text)
    reader.close()
    return reader


@pytest.fixture
def reader(data: ReportData) -> Reader:
    return read(page(data))


def test_tags_are_balanced_and_ids_are_unique(reader: Reader) -> None:
    assert reader.open == []
    assert len(set(reader.ids)) == len(reader.ids)


def test_all_sections_are_there_in_order(reader: Reader) -> None:
    assert tuple(reader.sections) == SECTIONS


def test_nothing_comes_from_outside(data: ReportData, reader: Reader) -> None:
    text = page(data)
    assert reader.references == []
    assert not re.search(r"(?i)https?://|//cdn|@import|url\(|import\s*\(|fetch\(|XMLHttp", text)


def test_names_from_outside_are_text_not_tags(data: ReportData, reader: Reader) -> None:
    assert "<of>" not in page(data)
    assert "a device <of> mine & yours" in reader.text["dd"]


def test_embedded_json_is_the_data(data: ReportData) -> None:
    element = re.search(r'<script type="application/json" id="data">(.*?)</script>', page(data))
    assert element is not None
    assert json.loads(element[1]) == json.loads(to_json(data))


def test_event_rows_say_what_the_record_says(reader: Reader, data: ReportData) -> None:
    for verdict in data.verdicts:
        assert verdict.truth is not None
        assert verdict.reported is not None
        row = reader.row(verdict.title, f"{verdict.truth.time:.3f} s")
        assert row[1].split() == [
            f"{verdict.truth.time:.3f}",
            "s",
            "frame",
            str(verdict.truth.frame),
        ]
        assert row[2].split()[0] == f"{verdict.reported.time:.3f}"
        assert row[2].split()[-1] == str(verdict.reported.frame)
        assert verdict.delay is not None
        assert int(row[3].split()[0].replace("−", "-")) == verdict.delay
        assert row[6] == "✓ passed"
    gross = reader.row("gross slip")
    assert gross[4] == "28.6°"  # 0.5 rad
    assert gross[5].split() == ["34.4°", "+5.7°"]  # 0.6 rad
    assert reader.row("twist")[4:6] == ["↺ y to x", "↺ y to x"]


def test_a_failing_event_is_shown_as_failing(record: SceneRecord) -> None:
    wrong = replace(record, events=(Event(time=0.6, kind="twist", frame=60, sense=1),))
    reader = read(page(ReportData(wrong)))
    failed = {cells[0].strip(): cells for kind, cells in reader.rows if kind}
    assert failed.keys() == {"contact", "incipient slip", "gross slip", "twist", "release"}
    assert failed["twist"][-1].strip() == "✗ wrong sense"
    assert failed["gross slip"][-1].strip() == "✗ missed"
    assert "5 of 5 events of “made & up” are wrong" in reader.text["h1"]


def test_a_failing_check_is_shown_as_failing(reader: Reader) -> None:
    names = [cells[0].strip() for kind, cells in reader.rows if kind == "failed"]
    assert names == ["WRONG"]
    assert reader.row("WRONG")[-1] == "✗ failed"
    assert reader.row("FINE") == [
        "FINE",
        "form",
        "opencl float32",
        "heun",
        "2.5 × 10⁻⁵",
        "1.0 × 10⁻³",
        "310 µs",
        "✓ passed",
    ]
    assert reader.row("EXACT")[4] == "0"


def test_plans_are_compared(reader: Reader, data: ReportData) -> None:
    full, _ = data.plans
    assert reader.row("demo")[1:3] == [f"{full.p50_us:.0f} µs", f"{full.p99_us:.0f} µs"]
    row = reader.row("contact only")
    assert row[1:4] == ["61.0 µs", "93.0 µs", "21 at most 210, 1 launch"]
    assert row[4] == "12.3 kflops at most 67.9 kflops"
    assert row[-1] == "normal"
    assert reader.row("channel shear_x") == ["channel shear_x", "nothing reads it", "48 B"]
    assert f"{100 * 61 / full.p50_us:.0f} % of" in reader.text["p"]


def test_latency_is_that_of_the_summary(reader: Reader) -> None:
    assert "120 µs" in reader.text["b"]  # 119.5
    assert "at most 120 µs, 99 % at most 158 µs" in reader.text["p"]


def test_key_frames_are_named_with_their_frame(reader: Reader) -> None:
    labels = [label for label in reader.labels if label.startswith("Frame ")]
    assert [label.split(": ")[1].split(",")[0] for label in labels] == [
        "before",
        "contact",
        "incipient slip",
        "gross slip",
        "twist",
        "release",
    ]
    assert "Frame 54: gross slip, 0.540 s" in labels


def test_a_record_without_truth_pitch_or_shear_has_a_page_too(record: SceneRecord) -> None:
    bare = replace(
        record,
        truth={},
        pitch=None,
        channels=("normal",),
        values=record.values[..., 2:],
        outputs={},
        unit="count",
    )
    reader = read(page(ReportData(bare)))
    assert reader.open == []
    assert tuple(reader.sections) == SECTIONS
    assert reader.row("gross slip")[1].split() == ["0.480", "s", "frame", "48"]


def test_a_record_in_which_nothing_ran_has_a_page_too(record: SceneRecord) -> None:
    bare = replace(
        record,
        values=np.full_like(record.values, np.nan),
        seconds=np.full_like(record.seconds, np.nan),
        truth={},
        events=(),
        outputs={},
    )
    assert tuple(read(page(ReportData(bare))).sections) == SECTIONS


def test_the_file_is_written_whole_and_nothing_beside_it(
    tmp_path: Path, data: ReportData, record: SceneRecord
) -> None:
    target = tmp_path / "report.html"
    target.write_text("before")
    with pytest.raises(ReportError, match="already exists"):
        write_demo_report(target, record, data.checks, data.work_precision, data.plans)
    assert target.read_text() == "before"
    write_demo_report(target, record, data.checks, data.work_precision, data.plans, force=True)
    write_demo_report(target, record, data.checks, data.work_precision, data.plans)  # its own
    assert target.read_text(encoding="utf-8") == page(data)
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_that_is_not_there_is_one_sentence(tmp_path: Path, record: SceneRecord) -> None:
    with pytest.raises(ReportError, match=r"cannot be written: there is no folder .*; choose a"):
        write_demo_report(tmp_path / "none" / "report.html", record)


def test_a_record_of_no_frame_is_refused(tmp_path: Path, record: SceneRecord) -> None:
    nothing: Any = replace(record, times=np.empty(0))
    with pytest.raises(ReportError, match="had no frame"):
        write_demo_report(tmp_path / "report.html", nothing)
    assert list(tmp_path.iterdir()) == []
