"""A device is used after it has shown that it works; the wheel of PoCL is repaired for that."""

import hashlib
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from cnnum.engines.devices import pocl, selection
from cnnum.engines.devices.child import Ended
from cnnum.engines.devices.selection import (
    SHELF,
    Verdict,
    keep_verdict,
    kept_verdict,
    subject_of,
)
from cnnum.engines.notices import Processor, read_cpuinfo
from cnnum.errors import NoOpenCLError

PLAYED = Path(__file__).parents[2] / "situations" / "generic_cpu"
ZEN_5 = """processor	: 0
vendor_id	: AuthenticAMD
cpu family	: 26
model		: 2
model name	: AMD EPYC 9655
flags		: {flags}

processor	: 1
model name	: another
"""


def python(code, tmp_path, **environment):
    """Run code where the processor is "generic", with no verdict kept, on the wheel alone."""
    others = tmp_path / "vendors"  # an empty folder: the system may have an OpenCL of its own
    others.mkdir(exist_ok=True)
    given = {
        "PYTHONPATH": str(PLAYED),
        "XDG_CACHE_HOME": str(tmp_path),
        "OCL_ICD_VENDORS": str(others),
        **environment,
    }
    return subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **given},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


@pytest.fixture
def device():
    return selection.choose_device(None)


@pytest.fixture
def wheel():
    """The wheel's device, which the repair is made for."""
    found = [d for d in selection.working_devices() if pocl.is_wheel(d.handle)]
    if not found:
        pytest.skip("the wheel of PoCL is not here")
    return found[0]


@pytest.fixture
def kept(device, tmp_path, monkeypatch):
    """An empty folder for verdicts, and a process that knows none; count the trials."""
    tried = []

    def trial(device, target):
        tried.append((device.label, target))
        return kept.answer

    kept = SimpleNamespace(tried=tried, answer=("", True), folder=tmp_path)
    monkeypatch.setenv("CNNUM_CACHE", str(tmp_path / "cnnum"))
    monkeypatch.setattr(selection, "try_in_child", trial)
    monkeypatch.setattr(selection, "_KNOWN", {})
    return kept


def test_a_generic_processor_is_refused_by_the_compiler(wheel, tmp_path):
    """The fault that is played is real: without the repair PoCL builds nothing."""
    code = (
        "import pyopencl as cl\n"
        "device = cl.get_platforms()[0].get_devices()[0]\n"
        "cl.Program(cl.Context([device]), '__kernel void none() {}').build()\n"
    )
    done = python(code, tmp_path)
    assert done.returncode == 1
    assert "unknown target CPU 'generic'" in done.stderr


def test_the_wheel_is_repaired(wheel, tmp_path):
    code = (
        "import cnnum, numpy as np\n"
        "engine, picture = cnnum.Engine(), -np.ones((8, 8))\n"
        "picture[2:6, 2:6] = 1\n"
        "result = engine.run(cnnum.get_template('EDGE'), input=picture)\n"
        "print(engine.name, (result.output > 0).sum())\n"
    )
    for _ in range(2):  # tried, and kept
        done = python(code, tmp_path)
        assert done.stdout.split() == ["opencl", "12"]  # black cells at the rim of 4×4, done.stderr
        assert done.stderr == ""
    (place,) = (tmp_path / "cnnum" / "verdicts").iterdir()
    checksum, record = place.read_bytes().split(b"\n", 1)
    assert checksum.decode() == hashlib.sha256(record).hexdigest()
    record = json.loads(record)
    assert (record["why"], record["target"]) == ("", pocl.best_target(read_here()))
    assert place.parent.stat().st_mode & 0o777 == 0o700


def read_here() -> Processor:
    return read_cpuinfo(Path("/proc/cpuinfo").read_text())


def test_commands_name_the_repair_and_measure_in_it(wheel, tmp_path):
    run = "import sys; from cnnum.cli import main; main(sys.argv[1:] or ['devices', '--json'])"
    done = python(run, tmp_path)
    assert done.returncode == 0, done.stderr
    (found,) = map(json.loads, done.stdout.splitlines())
    assert found["repaired"] == pocl.best_target(read_here())
    assert found["works"] is True
    assert found["chosen"] is True
    assert found["peak_gflops"] > 0.01


def test_a_device_that_cannot_be_repaired_is_listed_as_broken(wheel, tmp_path):
    run = "from cnnum.cli import main; main(['devices', '--json'])"
    done = python(run, tmp_path, CNNUM_PLAY="unrepairable")
    assert done.returncode == 0, done.stderr
    broken, host = map(json.loads, done.stdout.splitlines())
    assert (broken["works"], broken["chosen"]) == (False, False)
    assert "unknown target CPU 'generic'" in broken["broken"]
    assert (host["engine"], host["chosen"]) == ("numba", True)
    assert done.stderr.count("\n") == 1
    assert "does not work: it refuses a small kernel" in done.stderr
    code = "import cnnum; print(cnnum.Engine().name); cnnum.Engine('opencl')"
    done = python(code, tmp_path, CNNUM_PLAY="unrepairable")
    assert done.stdout.split() == ["numba"]
    assert "NoOpenCLError: OpenCL cannot be used because" in done.stderr


def test_the_repair_is_for_this_build_alone(wheel, monkeypatch):
    assert pocl.remedy_for(wheel.handle) is None  # its own name is right here
    monkeypatch.setattr(pocl, "BUILD", "OpenCL 3.0 PoCL 3.1")
    assert not pocl.is_wheel(wheel.handle)
    monkeypatch.undo()
    monkeypatch.setattr(pocl, "LIBRARY", "libpocl-of-another-build.so")
    assert not pocl.is_wheel(wheel.handle)


def test_targets_have_no_instruction_that_the_processor_lacks():
    wide = read_cpuinfo(ZEN_5.format(flags=" ".join(pocl.AVX512)))
    assert (wide.name, wide.family, wide.model) == ("AMD EPYC 9655", "26", "2")
    assert pocl.best_target(wide) == "skylake-avx512"
    for missing in pocl.AVX512 - pocl.AVX2:
        narrow = replace(wide, flags=wide.flags - {missing})
        assert pocl.best_target(narrow) == "haswell"
    assert pocl.best_target(replace(wide, flags=wide.flags - {"fma"})) is None
    assert read_cpuinfo("").flags == frozenset()


def test_a_processor_whose_random_seeds_are_off_keeps_its_vectors():
    """Linux turns Zen 5's faulty RDSEED off; PoCL asks for vectors of 16 by AVX-512 alone."""
    wide = read_cpuinfo(ZEN_5.format(flags=" ".join(pocl.AVX512 - {"rdseed"})))
    assert "rdseed" not in wide.flags
    assert pocl.target_for("generic", wide) == "skylake-avx512"


def test_a_name_that_is_right_is_kept():
    """LLVM 14 takes Zen 4 for "znver3", which has no AVX-512; on any other it stands."""
    wide = read_cpuinfo(ZEN_5.format(flags=" ".join(pocl.AVX512)))
    narrow = replace(wide, flags=pocl.AVX2)
    assert pocl.target_for("generic", wide) == "skylake-avx512"
    assert pocl.target_for("generic", narrow) == "haswell"
    assert pocl.target_for("znver3", wide) == "skylake-avx512"
    assert pocl.target_for("znver3", narrow) is None
    assert pocl.target_for("cascadelake", wide) is None


def test_a_verdict_is_kept(kept, device):
    assert selection.verdict_on(device).works
    selection._KNOWN.clear()  # the next process
    assert selection.verdict_on(device).works
    assert len(kept.tried) == 1
    selection.verdict_on(device, anew=True)
    assert len(kept.tried) == 2


def test_a_late_device_is_tried_again(kept, device):
    kept.answer = ("it gave no answer in 120 s", False)
    for _ in range(2):
        assert not selection.verdict_on(device).works
        selection._KNOWN.clear()
    assert len(kept.tried) == 2


@pytest.mark.parametrize("text", ["", "{", "[]", '{"why": 3}', "null", "\x00\xff"])
def test_a_verdict_that_cannot_be_read_is_none(kept, device, text):
    subject = subject_of(device, None)
    keep_verdict(subject, Verdict("", None))
    assert kept_verdict(subject) == Verdict("", None)
    (place,) = (kept.folder / "cnnum" / "verdicts").iterdir()
    SHELF.put(place.name, text.encode())
    assert kept_verdict(subject) is None
    assert selection.verdict_on(device).works
    assert len(kept.tried) == 1


def test_where_nothing_can_be_kept_devices_are_tried(kept, device):
    (kept.folder / "cnnum").write_text("a file in the place of the folder")
    assert selection.verdict_on(device).works
    assert len(kept.tried) == 1


def test_another_driver_is_tried_anew(kept, device):
    selection.verdict_on(device)
    selection._KNOWN.clear()
    selection.verdict_on(replace(device, driver="another"))
    assert len(kept.tried) == 2


def test_a_broken_device_is_passed_over_with_one_line(kept, device, monkeypatch, caplog):
    fast = replace(device, name="fast and broken", units=10 * device.units)
    answers = {fast.label: ("it is broken", True), device.label: ("", True)}
    monkeypatch.setattr(selection, "list_devices", lambda: (fast, device))
    monkeypatch.setattr(selection, "try_in_child", lambda one, target: answers[one.label])
    # the two stand for one handle here: only verdicts that are kept in files know them apart
    monkeypatch.setattr(selection, "_KNOWN", Forgetful())
    for _ in range(2):
        assert selection.choose_device(None) is device
    assert [record.message for record in caplog.records] == [
        f"OpenCL device '{fast.label}' does not work: it is broken; it is passed over."
    ]
    with pytest.raises(NoOpenCLError, match="it is broken"):
        selection.choose_device("fast and broken")


def test_a_gpu_is_used_when_it_is_asked_for(device, monkeypatch):
    gpu = replace(device, name="graphics", kind="GPU", units=100 * device.units, lanes=1)
    slow = replace(device, name="slower", units=1, clock_mhz=1)
    monkeypatch.setattr(selection, "list_devices", lambda: (gpu, slow, device))
    assert selection.devices_named(None) == [device, slow, gpu]
    assert selection.devices_named("graphics") == [gpu]


class Forgetful(dict):
    def __contains__(self, key):
        return False


@pytest.mark.parametrize("lanes", [1, 4, 8, 16])
def test_the_answer_is_known(device, lanes):
    assert selection.run_self_test(device.handle, lanes, double=device.double) == ""


def test_wrong_numbers_are_seen(device, monkeypatch):
    right = selection._expected
    monkeypatch.setattr(selection, "_expected", lambda dtype, width: right(dtype, width) + 1)
    why = selection.run_self_test(device.handle, 4, double=False)
    assert why == "a small kernel gives wrong numbers in float32"


def test_a_refusal_has_its_reason(device, monkeypatch):
    monkeypatch.setattr(selection, "_text", lambda real, width: "__kernel void self_test( {")
    why = selection.run_self_test(device.handle, 1, double=False)
    assert why.startswith("it refuses a small kernel (")
    assert "error" in why


@pytest.mark.parametrize(
    ("code", "lasting"), [(0, True), (-6, True), (1, False), (None, False)], ids=str
)
def test_only_what_the_device_did_itself_lasts(device, monkeypatch, code, lasting):
    """It answered, or its compiler ended the process; it was not late, nor was Python in error."""
    monkeypatch.setattr(selection, "run_child", lambda *given: Ended('"broken"\n', "", code))
    why, kept = selection.try_in_child(device, None)
    assert why
    assert kept is lasting


def test_how_a_child_ended_is_said():
    assert selection._why(Ended('""\n', "", 0)) == ""
    assert selection._why(Ended('"it refuses"\n', "", 0)) == "it refuses"
    assert "no answer in 120 s" in selection._why(Ended("", "", None))
    said = selection._why(Ended("", "LLVM ERROR: Cannot select: intrinsic\n", -6))
    assert (
        said == "it ended the process that tried it (Aborted: LLVM ERROR: Cannot select: intrinsic)"
    )
    assert "exit code 3" in selection._why(Ended("", "", 3))
