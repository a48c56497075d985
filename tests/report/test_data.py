"""The JSON in a report is the record, to the digits that it promises."""

import base64
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cnnum.report import SceneRecord
from cnnum.report.record import MAP_BYTES, ReportData, as_tree, stride, to_json


@pytest.fixture
def tree(data: ReportData) -> Any:
    return json.loads(to_json(data))


def unpacked(packed: dict[str, Any]) -> Any:
    whole = np.frombuffer(base64.b64decode(packed["data"]), "<i2").reshape(packed["shape"])
    return np.where(whole == packed["missing"], np.nan, whole * packed["scale"])


def test_series_have_seven_digits(tree: Any, record: SceneRecord) -> None:
    def same(got: Any, expected: Any) -> None:
        # seven significant digits: half a unit of the last is 5e-7 of a number that begins with 1
        np.testing.assert_allclose(np.array(got, float), expected, rtol=5e-7, equal_nan=True)

    same(tree["t"], record.times)
    same(tree["seconds"], record.seconds)
    assert tree["truth"].keys() == record.truth.keys()
    for name, values in record.truth.items():
        same(tree["truth"][name], values)
    assert tree["outputs"].keys() == {"contact", "incipient_slip", "gross_slip", "twist"}
    same(tree["outputs"]["contact"], record.outputs["contact"])


def test_maps_come_back_within_half_a_step(tree: Any, record: SceneRecord) -> None:
    for name, values in {"values": record.values, **record.maps()}.items():
        packed = tree["maps"][name]
        # rounded to whole steps; the rest is float64's
        half = 0.5001 * packed["scale"]
        np.testing.assert_allclose(unpacked(packed), values, rtol=0, atol=half, equal_nan=True)
    top = np.nanmax(np.abs(record.values))
    assert tree["maps"]["values"]["scale"] == pytest.approx(top / 32767)


def test_results_are_all_there(tree: Any, data: ReportData) -> None:
    assert tree["events"] == [event.record() for event in data.record.events]
    assert [v["text"] for v in tree["verdicts"]] == [v.text for v in data.verdicts]
    assert [c["error"] for c in tree["checks"]] == [c.error for c in data.checks]
    assert [p["seconds"] for p in tree["work_precision"]] == [
        p.seconds for p in data.work_precision
    ]
    assert [p["p50_us"] for p in tree["plans"]] == [p.p50_us for p in data.plans]
    left = data.plans[1].explanation.left_out[0]
    assert tree["plans"][1]["explanation"]["left_out"][0]["what"] == left.what


def test_machine_device_versions_and_date_are_inside(tree: Any, record: SceneRecord) -> None:
    here = record.environment
    assert tree["environment"]["device"] == here.device
    assert tree["environment"]["date"] == here.date
    assert tree["environment"]["machine"] == here.machine
    assert tree["environment"]["versions"] == dict(here.versions)
    assert {"cnnum", "Python", "numpy"} <= dict(here.versions).keys()


def test_an_infinite_error_is_null(data: ReportData) -> None:
    broken = replace(data, checks=(replace(data.checks[0], error=np.inf, passed=False),))
    assert json.loads(to_json(broken))["checks"][0]["error"] is None


def test_the_text_cannot_end_its_script_element(data: ReportData) -> None:
    assert "<" not in to_json(data)


def test_a_long_recording_keeps_every_so_many_maps(record: SceneRecord) -> None:
    times = 800
    long = replace(
        record,
        times=np.arange(times * record.frames) / record.rate,
        values=np.tile(record.values, (times, 1, 1, 1)),
        outputs={},
    )
    tree = as_tree(ReportData(long))
    maps: Any = tree["maps"]
    assert maps["every"] == stride(long) > 1
    assert len(base64.b64decode(maps["values"]["data"])) <= MAP_BYTES
    assert unpacked(maps["values"])[2] == pytest.approx(
        long.values[2 * maps["every"]], abs=maps["values"]["scale"]
    )
