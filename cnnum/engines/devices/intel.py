"""Intel's OpenCL runtime for processors, where pip has installed it (the extra `intel`).

Its wheel installs the library in a folder that OpenCL loaders do not search. For the first listing
of platforms, the loader is given a folder that lists it along with the platforms it would find
anyway.
"""

import os
import sys
from collections.abc import Generator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from tempfile import TemporaryDirectory

VARIABLE = "OCL_ICD_VENDORS"
"""Folder in which the loader of pyopencl's wheel looks. A value of the user's own stands."""

VENDORS = Path("/etc/OpenCL/vendors")
"""That of Linux, which it names unless it is told another."""


def runtime() -> Path | None:
    """Return the library of Intel's runtime, or None if pip has not installed it."""
    if sys.platform != "linux":
        return None
    try:
        files = distribution("intel-opencl-rt").files or []
    except PackageNotFoundError:
        return None
    places = (Path(str(file.locate())) for file in files if file.name == "libintelocl.so")
    return next((place.resolve() for place in places if place.exists()), None)


@contextmanager
def offered() -> Generator[None]:
    """List platforms within the block: Intel's is among them."""
    library = None if VARIABLE in os.environ else runtime()
    if library is None:
        yield
        return
    with TemporaryDirectory(prefix="cnnum-vendors-") as folder:
        for known in VENDORS.glob("*.icd"):
            (Path(folder) / known.name).symlink_to(known)
        (Path(folder) / "intel-from-pip.icd").write_text(f"{library}\n")
        os.environ[VARIABLE] = folder
        try:
            yield
        finally:
            os.environ.pop(VARIABLE, None)
