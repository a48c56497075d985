"""Without OpenCL every command runs on Numba, with one sentence on standard error that says so."""

import json
import subprocess
import sys

import pytest

from cnnum.engines.notices import how_to_get_opencl

NOWHERE = {"OCL_ICD_VENDORS": "/nonexistent/vendors"}
"""With it the loader of OpenCL finds no platform."""

SENTENCE = "cnnum: The numba engine runs because no OpenCL platform has a device; to get OpenCL, "


@pytest.mark.parametrize(
    "arguments",
    [
        ("devices",),
        ("plan", "contact"),
        ("run", "contact", "--frames", "20"),
        ("templates", "check", "EDGE"),
        ("bench", "throughput", "--quick", "--help"),
    ],
    ids=" ".join,
)
def test_commands_run_on_numba(shell, arguments):
    done = shell(*arguments, **NOWHERE)
    assert done.returncode == 0, done.stderr
    if "--help" not in arguments:
        assert done.stderr.startswith(SENTENCE)
        assert done.stderr.count("\n") == 1
    assert done.stdout


def test_the_host_is_the_device(shell, records):
    done = shell("devices", "--json", **NOWHERE)
    (found,) = records(done.stdout)
    assert (found["engine"], found["chosen"]) == ("numba", True)
    assert "core(s) of the host" in found["device"]


@pytest.mark.parametrize(
    "arguments",
    [
        ("templates", "check", "EDGE", "--engine", "opencl"),
        ("plan", "contact", "--engine", "opencl"),
        ("plan", "contact", "--device", "cuda"),
        ("devices", "--device", "cuda"),
    ],
    ids=" ".join,
)
def test_who_asks_for_opencl_gets_one_sentence(shell, arguments):
    done = shell(*arguments, **NOWHERE)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("cnnum: OpenCL cannot be used because no OpenCL platform")
    assert "conda-forge" in done.stderr
    assert done.stderr.count("\n") == 1


def test_without_pyopencl_itself():
    """A library user gets the same sentence, once, however many engines there are."""
    code = (
        "import sys; sys.modules['pyopencl'] = None\n"
        "import cnnum, numpy as np\n"
        "first, second = cnnum.Engine(), cnnum.Engine(precision='float64')\n"
        "print(first.name, second.precision)\n"
        "picture = -np.ones((8, 8)); picture[2:6, 2:6] = 1\n"
        "print((first.run(cnnum.get_template('EDGE'), input=picture).output > 0).sum())\n"
        "try: cnnum.Engine('opencl')\n"
        "except cnnum.CnnumError as error: print(type(error).__name__)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    # a square of 4×4 has a rim of 12
    assert done.stdout.split() == ["numba", "float64", "12", "NoOpenCLError"]
    assert done.stderr.startswith("The numba engine runs because PyOpenCL cannot be imported (")
    assert done.stderr.count("\n") == 1


def test_devices_without_pyopencl_itself():
    code = (
        "import sys; sys.modules['pyopencl'] = None\n"
        "from cnnum.cli import main; main(['devices', '--json'])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["engine"] == "numba"
    assert done.stderr.startswith("cnnum: The numba engine runs because PyOpenCL cannot")


def test_advice_fits_the_platform():
    linux, arm = how_to_get_opencl("linux", "x86_64"), how_to_get_opencl("linux", "aarch64")
    assert "pip install" in linux
    assert "pip install" not in arm
    assert "apt install" in arm
    for system in ("darwin", "win32", "freebsd13"):
        text = how_to_get_opencl(system, "arm64")
        assert "conda-forge" in text
        assert "apt" not in text
