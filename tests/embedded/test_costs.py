"""The question about costs: the cheapest configuration within bounds, or the nearest one."""

from dataclasses import replace

import pytest

from cnnum.cli.commands.bench_embedded import Wanted
from cnnum.lab.bench.charts import CHARTS
from cnnum.lab.bench.records import as_row
from cnnum.lab.embedded import costs
from cnnum.lab.embedded.answer import Bounds, answers, front
from cnnum.lab.embedded.cortex_m import missing_tools
from cnnum.lab.embedded.costs import CostRow
from cnnum.lab.embedded.scores import Loss
from tests.embedded.conftest import made, streams, too_long

ROW = CostRow(
    "slip", (8, 8), "q15", "auto", "m4", 65_000, 8_000, 17_000, 300, 168e6 / 65_000, 168e6,
    1e-2, "slip_strength", 0.0, 1.0, float("nan"), 0.0, 0,
)  # fmt: skip
ROWS = [
    ROW,
    replace(
        ROW, precision="q7", instructions=48_000, ram_bytes=4_000, error=0.9, frames_per_s=3_500.0
    ),
    replace(
        ROW,
        precision="float32",
        instructions=790_000,
        ram_bytes=11_000,
        error=1e-6,
        frames_per_s=210.0,
    ),
]
ASKED = {
    "programs": (), "shapes": (), "precisions": (), "methods": (), "cores": (), "quick": False,
    "clock": "168MHz", "max_error": None, "ram": None, "flash": None, "rate": None,
}  # fmt: skip


@pytest.mark.parametrize(
    ("bounds", "precision"),
    [
        (Bounds(), "q7"),
        (Bounds(error=0.1), "q15"),
        (Bounds(error=1e-3), "float32"),
        (Bounds(ram=5_000), "q7"),
        (Bounds(rate=3_000), "q7"),
    ],
)
def test_the_cheapest_within_the_bounds_is_named(bounds, precision):
    (sentence,) = answers(ROWS, bounds)
    assert sentence.startswith(f"slip on 8×8: the cheapest within the bounds is {precision} ")


def test_the_nearest_is_named_where_none_is_within():
    (sentence,) = answers(ROWS, Bounds(error=5e-3, ram=9_000))
    assert "none is within" in sentence
    assert "nearest is float32" in sentence
    assert "RAM 1.22×" in sentence


def test_only_what_none_betters_is_on_the_front():
    assert [row.precision for row in front([*ROWS, replace(ROW, error=2.0)])] == [
        "q7",
        "q15",
        "float32",
    ]


def test_amounts_have_suffixes():
    asked = ASKED | {"ram": "32k", "clock": "48 MHz", "rate": "1kHz", "flash": "0.5MB"}
    wanted = Wanted.of(asked)
    assert wanted.clock == 48e6
    assert wanted.bounds == Bounds(ram=32768.0, flash=2.0**19, rate=1000.0)
    assert len(wanted.cases) == 8


def test_a_picture_shows_every_configuration():
    figure = CHARTS["embedded"]([as_row(row) for row in ROWS])
    (legend,) = [axes.get_legend() for axes in figure.axes if axes.get_legend()]
    assert len(legend.get_texts()) == len(ROWS)


@pytest.mark.skipif(bool(missing_tools()), reason="needs the extra 'embedded'")
def test_a_program_is_counted_and_scored(monkeypatch):
    """On short streams, with the loss given; `make embedded` runs the whole way."""
    monkeypatch.setattr(costs, "made", lambda name, shape, *how: made(name, how[0], shape, how[1]))
    monkeypatch.setattr(costs, "vector_frames", lambda shape, count: streams(shape, count)[:, 0])
    monkeypatch.setattr(costs, "loss", lambda *given: Loss(0.25, "twist_strength", 0.0))
    (row,) = costs.measure_costs([("twist", (8, 8), "q15", "auto", "m4")], 48e6, 0)
    assert isinstance(row, CostRow)
    assert row.wrong == 0
    assert row.frames_per_s == 48e6 / row.instructions
    # one kHz at 168 MHz, and 24 KiB, are aims of slip and twist together
    assert row.instructions < 168_000
    assert row.ram_bytes < 24 * 1024


def test_what_has_no_form_is_left_out_with_the_reason(monkeypatch):
    monkeypatch.setattr(costs, "made", lambda name, shape, precision, method: too_long(precision))
    case = ("patient", (8, 8), "q15", "auto", "m4")
    (sentence,) = costs.measure_costs([case], 168e6, 0)
    assert sentence.startswith("patient on 8×8 in q15 by auto: ")
    assert "at most 100,000 are written" in sentence
