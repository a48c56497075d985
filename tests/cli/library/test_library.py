"""`cnnum templates` beyond list, show and check of names: files, folders, figures, pages."""

import shutil
import struct

import pytest

from cnnum.templating.files import load_entry, load_template
from cnnum.templating.library import template_path

MINE = """name = "lone"
description = "Lonely cells."
A = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
B = [[-1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, -1.0]]
z = -8.0
boundary = -1.0
duration = 8.0
check = { name = "rule", rule = "c and ring == 0" }
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "lone.toml").write_text(MINE)
    shutil.copy(template_path("EDGE"), tmp_path)
    return tmp_path


def test_check_of_a_folder(call, records, folder):
    found = records(call("templates", "check", folder, "--engine", "numba", "--json").stdout)
    assert {record["template"] for record in found} == {"EDGE", "lone"}
    edge = next(record for record in found if record["template"] == "EDGE")
    assert edge["margin"] > 0.5
    assert edge["settle"] > 0
    assert edge["note"] == ""


def test_a_weight_off_by_a_fifth_fails_the_check_of_a_measured_file(call, folder):
    path = folder / "edge.toml"
    text = path.read_text()
    assert text.count("8.0") == 1
    path.write_text(text.replace("8.0", "9.6"))
    result = call("templates", "check", path, "--engine", "numba")
    assert result.exit_code == 1
    assert "its numbers are not those that were measured" in result.stdout


def test_check_of_a_file_shows_what_designers_ask(call, folder):
    result = call("templates", "check", folder / "lone.toml", "--engine", "numba")
    assert result.exit_code == 0, result.stderr
    for part in ("monostable cells", "largest Euler step", "settles within", "mismatch 10 %"):
        assert part in result.stdout


def test_check_of_a_file_without_a_check_says_what_is_known(call, tmp_path):
    path = tmp_path / "bare.toml"
    path.write_text(MINE.partition("check =")[0])
    result = call("templates", "check", path, "--engine", "numba")
    assert result.exit_code == 2
    assert "has no check; name a closed form" in result.stderr
    for part in ("well-formed: layers 1", "monostable", "8×8: ", "not known without a check"):
        assert part in result.stdout


def test_design_shows_the_worst_case_where_there_is_a_bound(call, records):
    (found,) = records(call("templates", "design", "LOGAND", "--json").stdout)
    # a black cell falls while −1 + 2 (1 + δ) − 2 (1 − δ) is below 0, and does so in time
    assert 0.249 < found["worst_case"] < 0.25
    assert found["worst_case_weights"] == "A[1, 1] larger, B[1, 1] and z smaller in size"
    text = call("templates", "design", "LOGAND").stdout
    assert "less than 24.9 %" in " ".join(text.split())  # never rounded up
    (found,) = records(call("templates", "design", "HOLE", "--json").stdout)
    assert found["worst_case"] is None


def test_design_shows_how_far_each_weight_may_go(call, records):
    found = records(call("templates", "design", "THRES", "--weights", "--json").stdout)
    assert found[0]["stability"] == "bistable cells"
    assert found[0]["euler_step"] > 0
    assert {record["weight"] for record in found[1:]} == {"A[1, 1]", "z"}


def test_measure_writes_into_the_file(call, folder):
    path = folder / "lone.toml"
    result = call("templates", "measure", path)
    assert result.exit_code == 0, result.stderr
    entry = load_entry(path)
    assert entry.measured.digest == entry.template.digest
    assert entry.measured.margin > 0.5
    assert path.read_text().startswith(MINE)
    assert "EDGE" not in call("templates", "measure", folder, "--missing").stdout


def test_audit_counts_wrong_cells(call, records):
    (found,) = records(call("templates", "audit", "FIGREC", "--json").stdout)
    assert found["published"] == "0"
    assert found["wrong"][0] > 0
    assert found["wrong"][1] == 0


def test_import_and_export(call, tmp_path):
    out = tmp_path / "hole.tem"
    assert call("templates", "export", "HOLE", out).exit_code == 0
    target = tmp_path / "imported" / "here"
    result = call("templates", "import", out, "--to", target)
    assert result.exit_code == 0, result.stderr
    assert load_template(target / "hole.toml").A.tolist() == load_template(out).A.tolist()
    result = call("templates", "import", out, out, "--to", target)
    assert result.exit_code == 2
    assert "both contain a template 'HOLE'" in result.stderr
    broken = tmp_path / "broken.tem"
    broken.write_text("FEEDBACK\n1 2\n")
    result = call("templates", "import", broken)
    assert result.exit_code == 2
    assert "line 2: expected a square matrix" in result.stderr


def test_gallery_is_one_page(call, tmp_path, folder):
    out = tmp_path / "page.html"
    result = call("templates", "gallery", "HOLE", folder / "lone.toml", "--out", out)
    assert result.exit_code == 0, result.stderr
    page = out.read_text()
    assert page.count("<article") == 2
    assert page.count("data:image/png;base64,") == 8
    assert not [word for word in ("http:", "https:", "<link", "<script src") if word in page]
    assert "Settles within 8×8" in page


def test_show_says_what_is_known_and_draws(call, records, tmp_path):
    out = tmp_path / "hole.png"
    found, *_ = records(call("templates", "show", "HOLE", "--transient", out, "--json").stdout)
    assert found["state"] == "all black at the start"
    assert found["margin"] > 0.5
    data = out.read_bytes()
    width, height = struct.unpack(">2I", data[16:24])
    assert data.startswith(b"\x89PNG")
    assert min(width, height) > 0
    assert "settles within" in call("templates", "show", "HOLE").stdout


def test_no_picture_of_a_transient_that_has_no_time(call, tmp_path):
    file, out = tmp_path / "still.toml", tmp_path / "still.svg"
    file.write_text('name = "still"\nA = [[2.0]]\nduration = 0.0\n')
    refused = call("templates", "show", file, "--transient", out)
    assert refused.exit_code == 2
    assert "the duration 0, so there is no transient to show." in refused.stderr
    assert not out.exists()


def test_every_page_has_the_settle_time_or_why_there_is_none(call, tmp_path):
    out = tmp_path / "gallery.html"
    assert call("templates", "gallery", "HOLE", "LIFE", "AUTOWAVE", "--out", out).exit_code == 0
    page = out.read_text(encoding="utf-8")
    for stated in ("16×16: ", "runs in steps", "still on its way after 6 τ"):
        assert stated in page
    for name, stated in (
        ("HOLE", "16×16"),
        ("LIFE", "runs in steps"),
        ("ECHO", "still on its way"),
    ):
        assert stated in call("templates", "show", name).stdout


def test_a_check_that_shows_nothing_is_refused_and_the_others_run(call, records):
    """No row of seven cells holds the pattern of MATCH, whose right answers are all white."""
    options = ("--engine", "numba", "--shape", "1x7", "--json")
    both = call("templates", "check", "MATCH", "EDGE", *options)
    assert both.exit_code == 1
    assert [one["template"] for one in records(both.stdout)] == ["EDGE"]
    assert "'MATCH' shows nothing on 1×7 cells" in both.stderr
    alone = call("templates", "check", "MATCH", *options)
    assert alone.exit_code == 2
    assert "every correct output is white" in alone.stderr
