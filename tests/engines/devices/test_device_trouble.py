"""Trouble with a device ends in one sentence: kernels that are not built, memory, devices lost."""

import re
from pathlib import Path

import numpy as np
import pytest

import cnnum
from cnnum.errors import DeviceError, NotSupportedError, SizeError, UnknownNameError

cl = pytest.importorskip("pyopencl")

EDGE = cnnum.get_template("EDGE")


def sentence(raised):
    said = str(raised.value)
    assert "\n" not in said
    assert said.endswith(".")
    return said


def test_a_kernel_that_is_refused_is_kept_with_its_log(opencl, monkeypatch, tmp_path):
    from cnnum.engines.opencl import executable

    build = executable.build_program
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def torn(context, source, options=()):
        return build(context, source + "\nno_such_type nothing;", options)

    monkeypatch.setattr(executable, "build_program", torn)
    with pytest.raises(NotSupportedError) as raised:
        cnnum.Engine("opencl").run(EDGE, input=np.ones((5, 7)))
    (named,) = re.findall(r"'([^']*cnnum-kernel-[^']*)'", sentence(raised))
    text = Path(named).read_text()
    assert "void plan(" in text
    assert "no_such_type" in text  # in the compiler's log


@pytest.mark.parametrize(
    ("code", "kind", "said"),
    [
        ("MEM_OBJECT_ALLOCATION_FAILURE", SizeError, "ran out of memory"),
        ("OUT_OF_RESOURCES", DeviceError, "it may be lost"),
        ("DEVICE_NOT_AVAILABLE", DeviceError, "it may be lost"),
    ],
)
@pytest.mark.parametrize("batch", [(), (3,)], ids=["one frame", "a batch"])
def test_a_run_that_a_device_does_not_end(opencl, monkeypatch, code, kind, said, batch):
    engine = cnnum.Engine("opencl")
    picture = np.ones((*batch, 8, 8))
    expected = engine.run(EDGE, input=picture).output
    error = cl.MemoryError if kind is SizeError else cl.RuntimeError

    def lost(*given, **named):
        record = cl._cl._ErrorRecord(
            msg="", code=int(getattr(cl.status_code, code)), routine="enqueue"
        )
        raise error(record)

    with monkeypatch.context() as broken:
        broken.setattr(cl, "enqueue_nd_range_kernel", lost)
        with pytest.raises(kind) as raised:
            engine.run(EDGE, input=picture)
    assert said in sentence(raised)
    # a fault of the moment leaves the engine as it was
    np.testing.assert_array_equal(engine.run(EDGE, input=picture).output, expected)


@pytest.fixture
def lost():
    """Raise as a device that is lost does."""

    def raises(*given, **named):
        code = int(cl.status_code.DEVICE_NOT_AVAILABLE)
        raise cl.RuntimeError(cl._cl._ErrorRecord(msg="", code=code, routine="enqueue"))

    return raises


def test_the_host_goes_on_where_a_device_is_lost(opencl, monkeypatch, lost):
    engine = cnnum.Engine("opencl", fallback="numba")
    picture = np.where(np.indices((8, 8)).sum(axis=0) % 3, 1.0, -1.0)
    expected = engine.run(EDGE, input=picture)
    assert "numba" not in expected.reason
    with monkeypatch.context() as broken:
        broken.setattr(cl, "enqueue_nd_range_kernel", lost)
        found = engine.run(EDGE, input=picture)
    assert "on the numba engine, as device" in found.reason
    assert "numba" in engine.run("LOGAND", input=picture, state=picture).reason  # it stays lost
    assert engine.device == f"{cnnum.Engine('numba').device} (numba)"
    np.testing.assert_allclose(found.output, expected.output, atol=1e-3)


@cnnum.program
def kept(frame):
    """Return the frame before."""
    return {"before": frame.previous(frame.normal)}


@pytest.mark.parametrize("batch", [(), (3,)], ids=["one frame", "a batch"])
def test_a_stream_goes_on_with_memories_that_begin_anew(opencl, monkeypatch, lost, batch):
    engine = cnnum.Engine("opencl", fallback="numba")
    stream = engine.compile(kept, shape=(3, 4)).stream(batch)
    frames = np.random.default_rng(3).uniform(0.5, 1.0, (4, *batch, 3, 4, 3))
    assert "numba" not in stream.plan.explain().device
    seen = [stream.push(frames[n])["before"] for n in range(2)]
    with monkeypatch.context() as broken:
        broken.setattr(cl, "enqueue_nd_range_kernel", lost)
        seen += [stream.push(frames[n])["before"] for n in range(2, 4)]
    assert "on the numba engine" in stream.plan.explain().device
    np.testing.assert_allclose(seen[1], frames[0, ..., 2], rtol=1e-6)
    np.testing.assert_allclose(seen[2], frames[2, ..., 2], rtol=1e-6)  # as of a first frame
    np.testing.assert_allclose(seen[3], frames[2, ..., 2], rtol=1e-6)


def test_one_run_out_of_memory_leaves_the_device_to_others(opencl, monkeypatch):
    engine = cnnum.Engine("opencl", fallback="numba")
    picture = np.ones((5, 8, 8))

    def full(*given, **named):
        code = int(cl.status_code.MEM_OBJECT_ALLOCATION_FAILURE)
        raise cl.MemoryError(cl._cl._ErrorRecord(msg="", code=code, routine="enqueue"))

    with monkeypatch.context() as broken:
        broken.setattr(cl, "enqueue_nd_range_kernel", full)
        assert "ran out of memory" in engine.run(EDGE, input=picture).reason
    assert "numba" not in engine.run("LOGAND", input=picture, state=picture).reason


def test_a_fallback_is_known():
    with pytest.raises(UnknownNameError, match=r"fallback 'cuda'.*numba"):
        cnnum.Engine(fallback="cuda")
    assert cnnum.Engine("reference", fallback="numba").name == "reference"
