"""Throughput is a share of the best peak of the whole run, whenever that was measured."""

import json
from functools import partial

import numpy as np
import pytest

from cnnum.engines.devices import peak as device
from cnnum.engines.devices.peak import Figures, arithmetic_kernels
from cnnum.lab.bench import throughput
from cnnum.lab.bench.timing import Difference, Timing, difference
from cnnum.lab.commands import bench

SMALL = tuple(
    throughput.ThroughputCase(f"case {n}", (8, 8), 4, 1, 8, throughput.FULL) for n in range(3)
)


@pytest.fixture(autouse=True)
def _three_turns(monkeypatch):
    """As few as there are: peaks and their shares follow from three turns as from fifteen."""
    monkeypatch.setattr(throughput, "difference", partial(difference, runs=3))


@pytest.fixture
def peaks(monkeypatch):
    """Peaks that are measured one after the other; the list of those still to come."""

    def of(*rates):
        left = list(rates)

        def measured(device):
            rate = left.pop(0)
            if isinstance(rate, type):
                raise rate
            return Figures(rate, 1.0, next(arithmetic_kernels()).label, 1, "", 0.1)

        monkeypatch.setattr(device, "measure", measured)
        return left

    return of


def rows_of(found):
    """All rows, which come last."""
    *steps, rows = found
    assert steps == [None] * (len(SMALL) - 1)
    return rows


@pytest.mark.parametrize("place", range(4))
def test_every_row_is_a_share_of_the_best_peak_of_the_run(opencl, peaks, place):
    """Before the first case, between cases or after the last."""
    rates = [1.35e11] * 4
    rates[place] = 2.31e11
    left = peaks(*rates)
    rows = rows_of(throughput.measure_throughput(opencl, quick=True, cases=SMALL))
    assert left == []
    assert [row.case for row in rows] == [case.name for case in SMALL]
    for row in rows:
        assert row.peak_flops == 2.31e11
        assert row.share_of_peak == row.flops / 2.31e11
        assert 0 < row.share_in_turns < np.inf


def test_a_whole_run_measures_the_peak_often_before_and_after(opencl, peaks, monkeypatch):
    once = Difference(1.0, Timing(1.0, 1.0, 0.0, 1), 1.0)
    monkeypatch.setattr(throughput, "difference", lambda *calls, **options: once)
    left = peaks(*(2 * throughput.PEAKS + len(SMALL) - 1) * [1e11])
    rows_of(throughput.measure_throughput(opencl, cases=SMALL))
    assert left == []


@pytest.mark.parametrize("as_json", [True, False])
def test_no_row_is_shown_before_the_last_peak_is_known(opencl, peaks, capsys, as_json):
    peaks(1e11, 1e11, 1e11, 4e11)
    found, before = throughput.measure_throughput(opencl, quick=True, cases=SMALL), []

    def watched():
        for item in found:
            before.append(capsys.readouterr().out)
            yield item

    assert (
        bench._report("throughput", watched(), len(SMALL), opencl.device, None, False, as_json) == 0
    )
    assert before == [""] * len(SMALL)
    out = capsys.readouterr().out
    if as_json:
        rows = [json.loads(line) for line in out.splitlines()][:-1]
        assert [row["peak_flops"] for row in rows] == [4e11] * len(SMALL)
    else:
        # As words: a measured "6.44e+11" holds the same letters.
        assert out.split().count("4e+11") == len(SMALL)


def test_a_run_that_is_stopped_shows_the_rows_it_has(opencl, peaks, capsys):
    peaks(1e11, 3e11, KeyboardInterrupt)
    found = throughput.measure_throughput(opencl, quick=True, cases=SMALL)
    assert bench._report("throughput", found, len(SMALL), opencl.device, None, False, True) == 130
    *rows, omissions = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["case"] for row in rows] == ["case 0", "case 1"]
    assert {row["peak_flops"] for row in rows} == {3e11}
    assert "stopped" in omissions["omissions"][-1]


def test_frames_with_a_template_each_are_compared_with_their_own(opencl, peaks):
    peaks(1e11, 1e11)
    case = throughput.ThroughputCase("own", (8, 8), 16, 1, 8, throughput.FULL, own=True)
    ((row,),) = throughput.measure_throughput(opencl, quick=True, cases=(case,))
    # twenty steps of float32; another frame's template is a percent off, and 1e-4 to 1e-3 away
    assert row.error < 1e-5
    assert row.beside_one_template > 0.0
