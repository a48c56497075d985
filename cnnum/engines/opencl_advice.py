"""How to get OpenCL on this platform; it needs no OpenCL itself."""

import platform
import sys

_CONDA = "'conda install -c conda-forge pyopencl pocl'"

_WAYS = {
    "linux": f"'apt install pocl-opencl-icd' (Debian, Ubuntu), {_CONDA}, or a GPU's driver",
    "darwin": _CONDA,
    "win32": f"{_CONDA}, or a GPU's driver",
}

_WHEEL = "'pip install \"pyopencl[pocl]\"', "


def how_to_get_opencl(system: str = sys.platform, machine: str = platform.machine()) -> str:
    """Return the advice as part of a sentence.

    Parameters
    ----------
    system, machine : str
        As `sys.platform` and `platform.machine()` name them.
    """
    # the wheel of PoCL is made for this one platform
    wheel = _WHEEL if (system, machine) == ("linux", "x86_64") else ""
    return f"to get OpenCL, take one of: {wheel}{_WAYS.get(system, _CONDA)}"
