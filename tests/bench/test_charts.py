"""Pictures of benchmarks can be read: no text lies on another."""

import itertools

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from cnnum.bench.charts import CHARTS
from cnnum.bench.work_precision_chart import work_precision
from cnnum.program_library import program_names

PLACES = [("opencl", "float32"), ("opencl", "float64"), ("numba", "float32"), ("numba", "float64")]


def row(case, place, method, seconds, error):
    engine, precision = place
    return {
        "case": case, "engine": engine, "precision": precision, "method": method,
        "seconds": seconds, "error": error, "pictures": 1,
    }  # fmt: skip


def rows_of(decades, places):
    """A template whose methods differ by so many decades of time, and programs that do not."""
    rng = np.random.default_rng(0)
    methods = ("euler", "rk4", "propagator")
    template = [
        row("DIFFUS", place, method, 6e-6 * 10.0 ** (decades * n / 2), 10.0**-n)
        for place in places
        for n, method in enumerate(methods)
    ]
    programs = [
        row(name, place, "auto", 2e-6 * 10.0 ** rng.uniform(0, decades), 1e-6)
        for place in places
        for name in program_names("tactile")
    ]
    return template + programs


def drawn(figure):
    """All texts that are drawn: a tick beyond its axis keeps a label that is not."""
    for axes in figure.axes:
        yield from (axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts)
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = (*axis.get_major_ticks(), *axis.get_minor_ticks())
            yield from (tick.label1 for tick in ticks if low <= tick.get_loc() <= high)
    for legend in figure.legends:
        yield from legend.get_texts()


def boxes(figure):
    """Texts and their boxes, in pixels."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    seen = [text for text in drawn(figure) if text.get_visible() and text.get_text()]
    return [(text.get_text(), text.get_window_extent(canvas.get_renderer())) for text in seen]


@pytest.mark.parametrize("decades", [0.5, 2.0, 4.0])
@pytest.mark.parametrize("count", [1, 4])
def test_no_text_lies_on_another(decades, count):
    figure = work_precision(rows_of(decades, PLACES[:count]))
    seen = boxes(figure)
    assert {name for name, _ in seen} >= set(program_names("tactile"))
    # boxes hold room for accents above: a pixel of theirs may be shared
    overlaps = [
        (one, other)
        for (one, a), (other, b) in itertools.combinations(seen, 2)
        if min(a.x1, b.x1) - max(a.x0, b.x0) > 1 and min(a.y1, b.y1) - max(a.y0, b.y0) > 1
    ]
    assert overlaps == []


def test_programs_at_the_same_place_are_both_seen():
    """Markers differ in shape and are hollow: one does not cover the other."""
    figure = work_precision(rows_of(1.0, PLACES[:1]))
    lines = [line for line in figure.axes[-1].get_lines() if line.get_label()[0] != "_"]
    looks = {(line.get_marker(), line.get_color()) for line in lines}
    assert len(lines) == len(looks) == len(program_names("tactile"))
    assert {line.get_markerfacecolor() for line in lines} == {"none"}


@pytest.mark.parametrize("name", ["latency", "scenes", "throughput", "compile"])
def test_the_name_of_a_device_leaves_room_for_the_bars(name):
    """The longest that PoCL gives; it is the same in every row."""
    device = f"pthread-skylake-avx512-{'Xeon Processor ' * 3} (Portable Computing Language, 3.1)"
    rows = [
        {
            "case": case, "device": device, "p50_us": cost, "share_of_peak": cost, "cold_s": cost,
        }
        for case, cost in (("halfspace_equilibrium", 2000.0), ("contact", 20.0))
    ]  # fmt: skip
    figure = CHARTS[name](rows)
    FigureCanvasAgg(figure).draw()
    (axes,) = figure.axes
    assert axes.get_position().width > 0.5
    assert device in figure.get_suptitle()
