"""`cnnum bench all`: benchmarks of a row or none, and the fate of the others."""

import json

import click
import pytest

from cnnum.errors import MissingExtraError, NotSupportedError
from cnnum.lab.bench.charts import CHARTS
from cnnum.lab.bench.compile_time import CompileTime
from cnnum.lab.commands import bench

ROW = CompileTime("a dozen", "a device", 12, 2.0, 0.5, 1e-7)


def benchmark(measured):
    """A benchmark that goes through the same report as all do; its picture is that of builds."""

    @click.command("compile")
    @click.option("--frames", default=7)
    @bench._options
    def run(frames, device, quick, out, force, as_json):
        assert frames == 7  # options that are not given have their own defaults
        return bench._report("compile", measured(), None, "a device", out, force, as_json)

    return run


def rows():
    yield ROW
    yield "Anything [else] is left out."


def wants_an_extra():
    raise MissingExtraError("It wants celnn: install it with \"pip install '.[peers]'\".")


def fails():
    raise NotSupportedError("Expected a device with float64, got one without.")


def stops():
    yield ROW
    raise KeyboardInterrupt


def stops_before():
    raise KeyboardInterrupt


@pytest.fixture
def among(monkeypatch):
    """Put these benchmarks in the place of those that there are."""

    def put(**measured):
        made = {name: benchmark(one) for name, one in measured.items()}
        monkeypatch.setattr(bench.command, "commands", made | {"all": bench.every})

    return put


def test_all_are_all(monkeypatch, call):
    asked = []
    monkeypatch.setattr(bench, "run_all", lambda ctx, benchmarks, *given: asked.extend(benchmarks))
    assert call("bench", "all").exit_code == 0
    assert len(asked) == len(CHARTS)
    assert set(asked) == set(CHARTS)


def test_what_wants_an_extra_is_named_and_the_rest_goes_on(among, call):
    among(first=rows, second=wants_an_extra, third=rows)
    result = call("bench", "all")
    assert result.exit_code == 0
    assert result.stdout.count("a dozen") == result.stdout.count("cold_s") == 2
    assert result.stdout.count("Anything [else] is left out.") == 2
    end = result.stdout[result.stdout.index("Run to the end: first, third.") :]
    assert "second: It wants celnn" in end
    assert ".[peers]" in end  # not taken for markup
    assert result.stderr == ""


def test_what_fails_shows_in_the_code_and_the_rest_goes_on(among, call, records):
    among(first=fails, second=rows)
    result = call("bench", "all", "--json")
    assert result.exit_code == 2
    assert "cnnum bench first: Expected a device with float64" in result.stderr
    found = records(result.stdout)
    assert [record["kind"] for record in found] == ["compile", "omissions", "benchmarks"]
    assert found[0]["cold_s"] == 2.0
    assert found[-1]["run"] == ["second"]
    assert found[-1]["unfinished"] == {"first": "Expected a device with float64, got one without."}


@pytest.mark.parametrize("stopped", [stops, stops_before])
def test_a_stop_ends_them_all(among, call, records, stopped):
    among(first=rows, second=stopped, third=rows)
    result = call("bench", "all", "--json")
    assert result.exit_code == 130
    found = records(result.stdout)
    assert sum(record["kind"] == "compile" for record in found) == 1 + (stopped is stops)
    assert found[-1]["run"] == ["first"]
    assert list(found[-1]["unfinished"]) == ["second", "third"]


def test_options_reach_every_benchmark(among, call, tmp_path):
    among(first=rows)
    assert call("bench", "all", "--quick", "--out", tmp_path / "new").exit_code == 0
    kept = json.loads((tmp_path / "new" / "compile.json").read_text())
    assert kept["command"] == "cnnum bench compile --quick"
    assert [row["cold_s"] for row in kept["rows"]] == [2.0]


def test_a_wrong_device_begins_nothing(among, call, opencl):
    begun = []
    among(first=lambda: begun.append(1) or iter(()))
    result = call("bench", "all", "--device", "no such device")
    assert result.exit_code == 2
    assert "no such device" in result.stderr
    assert result.stderr.count("\n") == 1
    assert not begun
