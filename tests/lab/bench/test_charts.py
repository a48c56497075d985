"""Pictures of benchmarks can be read: no text lies on another."""

import itertools

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from cnnum.lab.bench.charts import CHARTS, work_precision

PLACES = [("opencl", "float32"), ("opencl", "float64"), ("numba", "float32"), ("numba", "float64")]


def row(case, place, method, seconds, error):
    engine, precision = place
    return {
        "case": case, "engine": engine, "precision": precision, "method": method,
        "seconds": seconds, "error": error, "pictures": 1,
    }  # fmt: skip


def rows_of(decades, places):
    """A template and programs whose methods differ by some decades of time."""
    methods = ("euler", "rk4", "propagator", "auto")
    return [
        row(case, place, method, 6e-6 * 10.0 ** (decades * n / 3), 10.0**-n)
        for case in ("DIFFUS", "halfspace_equilibrium", "slip")
        for place in places
        for n, method in enumerate(methods)
    ]


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


def test_a_case_that_no_method_changes_has_no_panel_and_is_named():
    level = [row("even", PLACES[0], m, 1e-5, error) for m, error in (("rk4", 1e-4), ("heun", 2e-4))]
    rows = [*rows_of(2.0, PLACES[:2]), *level]
    figure = work_precision(rows)
    labels = [axes.get_ylabel().split("\n")[0] for axes in figure.axes[::2]]
    assert labels == ["DIFFUS", "halfspace_equilibrium", "slip"]
    assert [text.get_text()[-4:] for text in figure.texts] == ["even"]
    # alone it has one, with nothing to name
    figure = work_precision(level)
    assert (len(figure.axes), figure.texts) == (1, [])


@pytest.mark.parametrize("decades", [0.5, 2.0, 4.0])
@pytest.mark.parametrize("count", [1, 4])
def test_no_text_lies_on_another(decades, count):
    figure = work_precision(rows_of(decades, PLACES[:count]))
    seen = boxes(figure)
    stated = " ".join(name for name, _ in seen)
    assert all(
        name in stated for name in ("DIFFUS", "halfspace_equilibrium", "slip", "auto", "rk4")
    )
    # boxes hold room for accents above: a pixel of theirs may be shared
    overlaps = [
        (one, other)
        for (one, a), (other, b) in itertools.combinations(seen, 2)
        if min(a.x1, b.x1) - max(a.x0, b.x0) > 1 and min(a.y1, b.y1) - max(a.y0, b.y0) > 1
    ]
    assert overlaps == []


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
