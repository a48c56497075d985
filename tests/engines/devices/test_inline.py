"""Few small frames run in the thread that asks, where PoCL has a device for that."""

import os
import subprocess
import sys

import numpy as np
import pytest

import cnnum
from cnnum.engines.devices import shared_arrays
from cnnum.engines.devices.listing import VARIABLE, list_devices, partner_of
from cnnum.engines.devices.selection import choose_device


@pytest.fixture
def partner():
    """The device that runs kernels in the thread that asks."""
    found = partner_of(choose_device(None).handle)
    if found is None or VARIABLE in os.environ:
        pytest.skip("no device here runs kernels in the thread that asks")
    return found


@cnnum.program
def half(frame):
    before = frame.previous(frame.normal)
    return {"half": 0.5 * frame.normal, "before": before, "sum": frame.normal.sum()}


def test_environment_is_left_as_it_was():
    before = dict(os.environ)
    list_devices()
    assert dict(os.environ) == before


def test_partners_are_not_listed():
    handles = [device.handle for device in list_devices()]
    assert not [handle for handle in handles if partner_of(handle) in handles]


def test_few_small_frames_run_elsewhere_and_what_fills_a_vector_does_not(opencl, partner):
    small = opencl.compile(half, (4, 5)).executable
    device = choose_device(None).handle
    assert small.queue_for(1).device == partner
    assert small.queue_for(3).device == partner
    # one vector of 8 lanes would still be few numbers
    assert small.queue_for(2 * small.wide_lanes).device == device
    medium = opencl.compile(half, (16, 16)).executable
    assert medium.queue_for(1).device == partner
    assert medium.queue_for(2).device == device
    large = opencl.compile(half, (40, 40)).executable
    assert large.queue_for(1).device == device


def test_few_frames_are_as_those_of_a_large_batch():
    plan = cnnum.Engine().compile(half, (4, 5))
    frames = np.random.default_rng(6).uniform(-1, 1, (64, 4, 5, 3))
    whole, few = plan(frames), plan(frames[:3])
    for name, values in few.items():
        np.testing.assert_array_equal(values, whole[name][:3])


def test_what_a_user_has_set_stands():
    text = "from cnnum.engines.devices.listing import list_devices; print(list_devices()[0].name)"
    environment = {**os.environ, VARIABLE: "basic"}
    found = subprocess.run(
        [sys.executable, "-c", text], env=environment, capture_output=True, text=True, check=False
    )
    if "PoCL" in choose_device(None).version:
        assert found.stdout.startswith("basic-")


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_stream_of_single_frames_is_as_streams_side_by_side(precision):
    """The quick way and the way of a batch, frame by frame, memories included."""
    plan = cnnum.Engine(precision=precision).compile(half, (4, 5))
    one, many = plan.stream(), plan.stream((3,))
    kept = []
    for frame in np.random.default_rng(3).uniform(-1, 1, (4, 4, 5, 3)):
        got, want = one.push(frame), many.push(np.stack([frame] * 3))
        for name, values in want.items():
            np.testing.assert_array_equal(got[name], values[1])
        kept.append((got, {name: values.copy() for name, values in got.items()}))
    for got, then in kept:  # results of a frame are not written over by the next one
        for name in got:
            np.testing.assert_array_equal(got[name], then[name])


def test_what_is_not_finite_is_refused_the_quick_way_too():
    @cnnum.program
    def inverse(frame):
        return {"many": frame.normal * 1e30 * 1e30, "one": frame.normal.sum()}

    stream = cnnum.Engine(precision="float32").compile(inverse, (4, 5)).stream()
    stream.push(np.zeros((4, 5, 3)))
    with pytest.raises(cnnum.CnnumError, match="Output 'many' of program 'inverse'"):
        stream.push(np.ones((4, 5, 3)))
    with pytest.raises(cnnum.CnnumError, match="finite"):
        stream.push(np.full((4, 5, 3), np.nan))


def test_devices_that_share_no_memory_are_sent_copies(monkeypatch):
    monkeypatch.setattr(shared_arrays, "shares_memory", lambda device: False)
    stream = cnnum.Engine().compile(half, (4, 5)).stream()
    frames = np.random.default_rng(4).uniform(-1, 1, (3, 4, 5, 3))
    got = [stream.push(frame) for frame in frames]
    for now, before, out in zip(frames, [frames[0], *frames], got, strict=False):
        np.testing.assert_allclose(out["half"], 0.5 * now[..., 2], rtol=1e-6)
        np.testing.assert_allclose(out["before"], before[..., 2], rtol=1e-6)
