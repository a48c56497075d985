"""Tables of commands: a number is whole or not there, and a missing one is named."""

import json
import shlex
from dataclasses import dataclass

import pytest

from cnnum.cli import output as fitted_tables
from cnnum.cli.output import Output, table
from cnnum.lab.bench.page import cell
from cnnum.lab.bench.records import as_row
from cnnum.lab.bench.scene_costs import SceneCost
from cnnum.lab.bench.throughput import Throughput
from cnnum.lab.commands import bench

LONG = "8×8×3, batch 1024, equal weights, 5×5"


def scene(case):
    return SceneCost(
        case, "a device", 12.94, 21.06, 0.2444, 40.3, 4.61, 1365, 3, 13, 768, 3428, 16000, 3.99e-7,
        0, 260,
    )  # fmt: skip


def rate(case):
    return Throughput(
        case, "a device", "float32", (1024, 1024), 65_536, 1.26e10, 1.24e10, 2.77e11, 2.31e11,
        1.199, 1.234, 0.4321, 1.23e-3, 7.65e-7,
    )  # fmt: skip


@dataclass
class Peer:
    case: str
    peer: str
    peer_version: str
    device: str
    peer_method: str
    ratio: float
    error: float


def peer(case):
    return Peer(case, "SciPy ndimage", "1.17.1", "a device", "Euler, dt 0.00021", 1.99e4, 5.56e-6)


ROWS = {"scenes": scene, "throughput": rate, "peers": peer}


def printed(name, capsys, found=None):
    """The lines of a benchmark's table, above the cases left out."""
    rows = [ROWS[name](case) for case in ("small", LONG)] if found is None else found
    assert bench._report(name, rows, None, "a device", None, False, False) == 0
    return capsys.readouterr().out.split("Left out:")[0].splitlines()


@pytest.fixture
def terminal(monkeypatch):
    def of(columns):
        monkeypatch.setattr("cnnum.cli.output.on_terminal", lambda: True)
        monkeypatch.setenv("COLUMNS", str(columns))
        monkeypatch.delenv("LINES", raising=False)

    return of


def values(name):
    """Texts of a row's numbers, by column."""
    fields = as_row(ROWS[name](LONG))
    return {key: cell(value) for key, value in fields.items() if key not in ("device", "case")}


@pytest.mark.parametrize("name", ROWS)
def test_a_pipe_gets_every_column_whole(name, capsys):
    lines = printed(name, capsys)
    assert lines[0] == "On a device."
    head = next(line for line in lines if line.lstrip().startswith("case"))
    assert head.split() == ["case", *values(name)]
    (row,) = [line for line in lines if line.lstrip().startswith(LONG)]
    rest = row.replace(LONG, "", 1)
    for text in values(name).values():
        assert f" {text} " in f"{rest} "


@pytest.mark.parametrize("columns", [60, 80, 100, 120, 160])
@pytest.mark.parametrize("name", ROWS)
def test_a_terminal_gets_whole_numbers_or_the_names_of_columns(name, columns, capsys, terminal):
    terminal(columns)
    lines = printed(name, capsys)
    assert max(map(len, lines)) <= columns
    text = " ".join(" ".join(lines).split())
    stated = text.partition(f"No room in {columns} columns: ")[2].rstrip(".").split(", ")
    shown = [line for line in lines if "No room" not in line]
    words = set(" ".join(shown).split())
    assert "case" in words
    assert any(line.lstrip().startswith("8×8×3") for line in shown)
    for key, value in values(name).items():
        assert key in stated or set(value.split()) <= words, (key, value)
    # a folded text is a header, and it is there whole
    for key in values(name):
        parts = set(key.split("_"))
        seen = {piece for word in words for piece in word.split("_")}
        assert key in stated or parts <= seen


def test_a_wide_terminal_leaves_nothing_out(capsys, terminal):
    terminal(250)
    assert not [line for line in printed("scenes", capsys) if "No room" in line]


def test_columns_go_in_the_order_that_is_asked_for(capsys, terminal):
    terminal(28)
    made = table("case", ">first", ">second", ">third")
    made.add_row("a case", "1.2345", "6.7891", "2.3456")
    Output(False).show(made, spare=("second",))
    out = capsys.readouterr().out
    assert "No room in 28 columns:" in out
    assert "second" in out.split("columns:")[1]
    assert "1.2345" in out
    assert "2.3456" in out
    assert "6.7891" not in out


@pytest.mark.parametrize(
    ("columns", "stated"),
    [(65, ""), (45, "about"), (30, "time, about"), (20, "error, time, about")],
)
def test_a_verdict_goes_after_texts_and_numbers(columns, stated):
    made = table("case", ">error", ">time", "result", "about")
    made.add_row("a case", "1.2345", "6.7891 ms", "passed", "a long text on what this row is about")
    kept, gone = fitted_tables.fitted(made, columns)
    assert ", ".join(gone) == stated
    assert "result" in [column.header for column in kept.columns]


def test_headers_fold_at_their_underscores_before_a_column_goes():
    made = table("case", ">cell_updates_per_s", ">share_of_peak")
    made.add_row("a case", "1.26e+10", "0.953")
    narrow, gone = fitted_tables.fitted(made, 28)
    assert gone == ()
    heads = [column.header for column in narrow.columns]
    assert heads == ["case", "cell_\nupdates_\nper_s", "share_\nof_\npeak"]


def test_the_devices_column_stays_where_rows_differ_in_it(capsys):
    rows = [peer("small"), peer(LONG)]
    rows[1].device = "another device"
    lines = printed("peers", capsys, rows)
    assert any("another device" in line for line in lines)


def test_json_has_all_of_it(capsys):
    bench._report("scenes", [scene(LONG)], None, "a device", None, False, True)
    record = json.loads(capsys.readouterr().out.splitlines()[0])
    assert (record["case"], record["ops"]) == (LONG, 1365)


@pytest.mark.parametrize(
    ("typed", "kept"),
    [
        ("", "work-precision"),
        ("--quick --device 'AMD EPYC'", "work-precision --device 'AMD EPYC' --quick"),
        ("--case DIFFUS --case EDGE --json", "work-precision --case DIFFUS --case EDGE"),
        ("--frames 8000", "latency --frames 8000"),
        ("--frames 20000", "latency"),
    ],
)
def test_data_names_the_command_that_made_it(typed, kept, tmp_path):
    name = kept.split()[0]
    words = [*shlex.split(typed), "--out", str(tmp_path)]
    with bench.command.commands[name].make_context(name, words):
        bench._report("scenes", [scene("slip")], None, "a device", tmp_path, False, False)
        assert bench._asked(name) == f"cnnum bench {kept}"
        stated = json.loads((tmp_path / "scenes.json").read_text())["command"]
        assert stated == f"cnnum bench {kept}".replace(name, "scenes")


def test_brackets_are_text_and_no_markup(capsys):
    shown = Output(as_json=False)
    cells = table("Name", "Install")
    cells.add_row("covers[1].npz", "pip install '.[fem]'")
    shown.show("Written: covers[1].npz; pip install '.[fem]'", cells)
    first, *rest = capsys.readouterr().out.splitlines()
    assert first == "Written: covers[1].npz; pip install '.[fem]'"
    assert any("covers[1].npz" in line and "'.[fem]'" in line for line in rest)
