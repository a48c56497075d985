"""`cnnum demo`: events, a report, a summary that names it."""

import pytest

from cnnum.cli.commands import demo as demo_report

SHORT = (
    'array.script=[{kind="hold",duration=0.3},{kind="press",load=1,duration=0.2},'
    '{kind="hold",duration=0.2},{kind="release",duration=0.2},{kind="hold",duration=0.1}]'
)


@pytest.fixture
def quick(monkeypatch):
    """Two templates instead of the library: each is measured alike."""
    monkeypatch.setattr(demo_report, "template_names", lambda: ("EDGE", "smooth"))
    monkeypatch.setattr(demo_report, "LADDERS", ("tactile_diffusion",))


def test_events_report_and_summary(call, records, quick, tmp_path):
    path = tmp_path / "tap.html"
    result = call("demo", "--out", path, "--set", SHORT, "--json")
    assert result.exit_code == 0, result.stderr
    *events, summary = records(result.stdout)
    assert "cover" not in result.stderr  # the simulated array knows its own
    kinds = [event["kind"] for event in events]
    assert (kinds[0], kinds[-1]) == ("contact", "release")
    assert (summary["kind"], summary["report"]) == ("summary", str(path))
    page = path.read_text()
    assert page.lstrip().lower().startswith("<!doctype html>")
    # figures of templates are in it, too
    assert all(name in page for name in ("EDGE", "smooth", "tactile_diffusion", "reference"))
    assert [item.name for item in tmp_path.iterdir()] == ["tap.html"]


def test_the_report_goes_to_the_working_folder(call, quick, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = call("demo", "--set", SHORT)
    assert result.exit_code == 0, result.stderr
    assert "cnnum-demo.html" in result.stdout
    assert (tmp_path / "cnnum-demo.html").stat().st_size > 10_000
