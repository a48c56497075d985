"""Trouble with a device ends in one sentence: kernels that are not built, memory, devices lost."""

import re
from pathlib import Path

import numpy as np
import pytest

import cnnum
from cnnum.errors import DeviceError, NotSupportedError, SizeError

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
        ("MEM_OBJECT_ALLOCATION_FAILURE", SizeError, "has no memory left"),
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
