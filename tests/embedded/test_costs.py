"""The question about costs: the cheapest configuration within bounds, or the nearest one."""

from dataclasses import replace
from math import isnan
from types import SimpleNamespace

import numpy as np
import pytest

import cnnum
from cnnum.embedded.lowering.builder import solvers_for
from cnnum.errors import UnknownNameError
from cnnum.frame import FORCE_AXES
from cnnum.graph.schedule import schedule
from cnnum.integrators.closed_forms import Propagator, Spectral
from cnnum.lab.bench.charts import CHARTS
from cnnum.lab.bench.records import as_row
from cnnum.lab.commands.bench import Wanted
from cnnum.lab.embedded import costs
from cnnum.lab.embedded.cortex_m import missing_tools
from cnnum.lab.embedded.costs import Bounds, CostRow, answers, front, page_table
from cnnum.programs.library import program_names
from tests.embedded.conftest import made, streams, too_long

ROW = CostRow(
    "slip", (8, 8), "q15", "auto", "m4", 65_000, 8_000, 17_000, 1e-2, "slip_strength",
    0.0, 1.0, float("nan"), 0.0, 0.0, 168e6 / 65_000, 168e6, 300, 0,
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
    "costs": False, "clock": "168MHz", "max_error": None, "ram": None, "flash": None, "rate": None,
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


def test_several_programs_are_counted_as_one():
    (case, *_) = Wanted.of(ASKED | {"programs": ("slip,twist",)}).cases
    assert case[0] == "slip,twist"
    with pytest.raises(UnknownNameError, match="'slap'"):
        Wanted.of(ASKED | {"programs": ("slip,slap",)})


def test_a_picture_shows_every_configuration():
    figure = CHARTS["embedded"]([as_row(row) for row in ROWS])
    (legend,) = [axes.get_legend() for axes in figure.axes if axes.get_legend()]
    # the front, too
    assert len(legend.get_texts()) == len(ROWS) + 1
    left = figure.axes[0]
    points = {line.get_label(): line.get_color() for line in left.lines}
    assert len(set(points.values())) == len(ROWS) + 1


def test_both_methods_of_a_precision_have_its_colour():
    rows = [ROW, replace(ROW, method="euler", instructions=90_000), ROWS[1]]
    lines = CHARTS["embedded"]([as_row(row) for row in rows]).axes[0].lines
    q15, euler, q7 = (line.get_color() for line in lines if "m4" in line.get_label())
    assert q15 == euler != q7


@pytest.mark.skipif(bool(missing_tools()), reason="needs the extra 'embedded'")
def test_a_program_is_counted_and_scored(monkeypatch):
    """On short streams, and the costs alone; `make embedded` runs the whole way."""
    monkeypatch.setattr(costs, "made", lambda name, shape, *how: made(name, how[0], shape, how[1]))
    monkeypatch.setattr(costs, "vector_frames", lambda shape, count: streams(shape, count)[:, 0])
    case = ("twist", (8, 8), "q15", "auto", "m4")
    (row,) = costs.measure_costs([case], 48e6, 0, only_costs=True)
    assert isinstance(row, CostRow)
    assert row.wrong == 0
    assert row.frames_per_s == 48e6 / row.instructions
    assert row.instructions < row.plain_instructions < 1.2 * row.instructions
    # one kHz at 168 MHz, and 24 KiB, are aims of slip and twist together
    assert row.instructions < 168_000
    assert row.ram_bytes < 24 * 1024


def test_costs_are_rows_of_the_documentation():
    both = replace(
        ROW, case="slip,twist", plain_instructions=70_000, cycles_least=6e4, cycles_most=9e4
    )
    slow = replace(both, case="slip", plain_instructions=ROW.instructions, cycles_most=2e5)
    head, _, *rows = page_table([both, slow], (200.0, 1000.0))
    assert head.endswith("| fits 200 Hz, 1 kHz |")
    assert rows == [
        "| `slip`, `twist` | 65,000 (70,000) | 60,000 to 90,000 | 8,000 | 17,000 | yes, yes |",
        "| `slip` | 65,000 | 60,000 to 200,000 | 8,000 | 17,000 | yes, unsure |",
    ]
    # what differs between rows stands with the program
    there = replace(slow, core="m7", cycles_most=float("inf"))
    *_, last = page_table([slow, there], (200.0,))
    assert last == "| `slip`, m7 | 65,000 | 60,000 to more | 8,000 | 17,000 | unsure |"


def test_what_has_no_form_is_left_out_with_the_reason(monkeypatch):
    monkeypatch.setattr(costs, "made", lambda name, shape, precision, *how: too_long(precision))
    case = ("patient", (8, 8), "q15", "auto", "m4")
    (sentence,) = costs.measure_costs([case], 168e6, 0)
    assert sentence.startswith("patient on 8×8 in q15 by auto: ")
    assert "at most 200,000" in sentence


def test_flags_that_differ_are_a_share_of_those_that_are_up():
    one, other = ({"flag": np.array(some)} for some in ([1, 1, 0, 0, 0], [1, 0, 1, 0, 0]))
    assert costs._unlike(one, other, ["flag"]) == pytest.approx(2 / 3)
    assert costs._unlike(one, one, ["flag"]) == 0.0
    assert isnan(costs._unlike({"flag": np.zeros(3)}, {"flag": np.zeros(3)}, ["flag"]))


def test_reports_are_compared_with_those_of_float32(monkeypatch):
    """A twist of 40 frames, which is seen 10 frames later; frames after the scene do not count."""
    sense = np.zeros(100)
    sense[50:90] = 1.0
    scene = SimpleNamespace(
        frames=np.zeros((100, 2, 2, 3)), seconds=0.5, sense=sense, scored=np.ones(100, dtype=bool)
    )
    longer = SimpleNamespace(**vars(scene) | {"frames": np.zeros((120, 2, 2, 3))})
    longer.sense, longer.scored = np.zeros(120), np.ones(120, dtype=bool)
    monkeypatch.setattr(costs, "trials", lambda *given: (scene, longer))

    def program(start):
        flags = np.zeros((120, 2))
        flags[start:90, 0] = flags[100:, 0] = 1.0
        return SimpleNamespace(
            program=SimpleNamespace(name="delayed", outputs=("twist",)),
            run=lambda frames: {"twist": flags, "twist_sense": flags},
        )

    monkeypatch.setattr(costs, "made_program", lambda *given: program(50))
    found = costs.events(program(60), (2, 2), 1, "p")
    assert found.reports_differ == pytest.approx(10 / 40)
    assert (found.twist_recall, found.false_reports) == (1.0, 0.0)
    assert isnan(found.slip_recall)


def test_outputs_of_a_release_are_compared_where_there_is_one(fast):
    """`off_strength` was compared over three frames of noise: half of it was said to be wrong."""
    frames = costs.excerpt((8, 8), remembers=True)
    plan = fast.compile(cnnum.get_program("on_off").bind(rate=200.0), (8, 8), ["off_strength"])
    stream = plan.stream((frames.shape[1],))
    found = np.array([stream.push(frame)["off_strength"] for frame in frames])
    assert (found[costs.EXCERPT :].max(axis=0) > 100.0).all()
    assert found[: costs.EXCERPT].max() < 10.0


@pytest.mark.parametrize("rate", [50.0, 200.0, 1000.0, 5000.0])
def test_euler_steps_as_exact_as_q15_would_cost_more_than_exact_products(rate):
    """Which is why `auto` takes the products: by products of numbers, over the library's programs.

    After n steps of a time T, the states of a linear array are off by (λT)²/2n of their range at
    most; if they go on from frame to frame, they lag by λT/2n. λ is the largest sum of a row.
    """
    compared = 0
    for name in (*program_names("tactile"), *program_names("pictures")):
        channels = ("picture",) if name in program_names("pictures") else FORCE_AXES
        traced = cnnum.get_program(name).bind(rate=rate).trace((8, 8), channels)
        wanted = schedule(traced, channels, None)
        for node, solver in zip(wanted.transients, solvers_for(wanted).values(), strict=True):
            template, scheme = node.operation.template, solver.scheme
            if solver.settle or not isinstance(scheme, Propagator | Spectral):
                continue
            layers, cells = template.layers, 64
            sums = np.abs(template.A).sum(axis=(1, 2, 3)) + 1.0
            fast = solver.duration * float((sums / template.tau).max())
            goes_on = any(
                node.index in {argument.index for argument in memory.store.arguments}
                for memory in wanted.memories.values()
            )
            steps = np.ceil(2.0**15 * (fast / 2.0 if goes_on else fast * fast / 2.0))
            if isinstance(scheme, Spectral):  # along rows and columns, there and back
                products = cells * (16 * 2 * layers + 16 * layers + 2 * layers * layers)
            else:
                products = 2 * (layers * cells) ** 2
            taps = int(np.count_nonzero(template.A))
            assert steps * taps * cells > products, (name, template.name)
            compared += 1
    assert compared > 5
