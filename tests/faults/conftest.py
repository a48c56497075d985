"""Good caches, and copies of them."""

import itertools
import shutil

import pytest
from cached_runs import SUM, TRANSIENT, child, environment, lost

import cnnum


@pytest.fixture(scope="package")
def good(tmp_path_factory):
    """A folder of good caches: ours, and those that PoCL and PyOpenCL keep by themselves."""
    folder = tmp_path_factory.mktemp("good")
    if cnnum.Engine().name == "opencl":
        own = {"POCL_CACHE_DIR": str(folder / "pocl" / "kcache"), "PYOPENCL_NO_CACHE": "0"}
        for given in ({}, own):
            assert not lost(
                child("opencl", TRANSIENT, environment(folder, **given)), TRANSIENT, "opencl"
            )
        assert list(folder.glob("cnnum/kernels/*"))
        assert list(folder.glob("cnnum/verdicts/*"))
        assert list(folder.glob("pocl/kcache/*/*/program.bc"))
        assert list(folder.glob("pytools/*.sqlite"))
    assert not lost(child("numba", SUM, environment(folder)), SUM, "numba")
    assert list(folder.glob("cnnum/numba/*"))
    return folder


@pytest.fixture
def copied(good, tmp_path):
    """Copies of the good caches, one a trial."""
    numbers = itertools.count()

    def copy():
        folder = tmp_path / str(next(numbers))
        shutil.copytree(good, folder)
        return folder

    return copy
