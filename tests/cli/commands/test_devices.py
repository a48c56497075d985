"""`cnnum devices`: the measured figures stand to reason."""

import pytest

from cnnum.engines.devices import peak as room
from cnnum.engines.devices.listing import list_devices
from cnnum.engines.devices.peak import Arithmetic, Bench, measure
from cnnum.engines.devices.selection import choose_device
from cnnum.errors import DeviceError


def test_every_device_with_its_figures(call, records):
    result = call("devices", "--json")
    assert result.exit_code == 0, result.stderr
    found = records(result.stdout)
    assert [record["device"] for record in found] == [device.name for device in list_devices()]
    for record in found:
        # a clock of 10 GHz, 128 multiply-adds a beat and 1000 units bound a peak from above
        assert 0.01 < record["peak_gflops"] < 2 * 128 * 10 * record["units"]
        assert 0.01 < record["bandwidth_gbs"] < 2e4
        assert record["version"].startswith("OpenCL")
    (chosen,) = [record for record in found if record["chosen"]]
    assert chosen["device"] == choose_device(None).name
    assert chosen["why"]


def test_in_words_and_without_measuring(call, monkeypatch):
    def measured(device: object) -> None:
        raise AssertionError("it was measured")

    monkeypatch.setattr(room, "measure", measured)
    text = call("devices", "--no-measure").stdout
    assert "GFLOP/s" not in text
    assert f"yes: {'the only' if len(list_devices()) == 1 else 'it promises most'}" in text


def test_the_arithmetic_is_really_done():
    """Twice the chains are twice the operations: the rate stays, so nothing is dropped."""
    bench = Bench(choose_device(None))
    rates = {8: 0.0, 16: 0.0}
    for _ in range(8):  # the best of each counts: a busy machine only makes runs slower
        for chains, best in rates.items():
            rates[chains] = max(best, bench.flops(Arithmetic(4, chains), repeats=3))
        if 0.25 < rates[8] / rates[16] < 4.0:
            return
    pytest.fail(f"work is dropped: {rates}")


def test_a_compiler_that_ends_the_process_costs_one_kernel(monkeypatch):
    said = '["copy", "c", 1e9]\n["arithmetic", "one", 2e9]\n["try", "two", 0.0]\n'
    monkeypatch.setattr(room, "_child", lambda place, budget: said)
    figures = measure(choose_device(None))
    assert (figures.flops, figures.kernel, figures.kernels) == (2e9, "one", 1)
    assert figures.failed == "two"


def test_a_device_that_runs_nothing(monkeypatch):
    monkeypatch.setattr(room, "_child", lambda place, budget: '["try", "first", 0.0]\n')
    device = choose_device(None)
    with pytest.raises(DeviceError, match="failed at 'first'"):
        measure(device)


def test_a_device_gives_known_answers(call, records, opencl):
    result = call("devices", "--self-test", "--device", opencl.device, "--json")
    assert result.exit_code == 0, result.stdout
    tested = [record for record in records(result.stdout) if "tests" in record]
    assert {record["precision"] for record in tested} >= {"float32"}
    assert all(record["passed"] and record["tests"] >= 10 for record in tested)


def test_a_device_that_computes_wrong_numbers_is_caught(call, opencl, monkeypatch):
    """A compiler that drops a product: kernels are built of another text."""
    from cnnum.cli.commands import devices as device_tests
    from cnnum.engines.opencl import executable

    # one in waves, in steps, and one of cells alone, exact: every answer of all seven takes long
    monkeypatch.setattr(device_tests, "TEMPLATES", ("HOLE", "EDGE"))
    build = executable.build_program

    def miscompiled(context, source, options=()):
        return build(context, source.replace(" * ", " + ", 1), options)

    monkeypatch.setattr(executable, "build_program", miscompiled)
    result = call("devices", "--self-test")
    assert result.exit_code == 1
    assert "off by" in result.stdout
