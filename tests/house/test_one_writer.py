"""All is written through `cnnum.safety.files`, and what users name is read through `.reading`."""

import ast
from pathlib import Path

import pytest

pytestmark = pytest.mark.promise("Nothing in the code writes but through the one writer.")
ROOT = Path(__file__).parents[2]
WRITER = "cnnum/safety/files.py"

BY_NAME = {
    *("write_text", "write_bytes", "savefig", "to_netcdf", "to_zarr", "to_csv", "to_pickle"),
    *("savez", "savez_compressed", "savetxt", "tofile", "dump", "write_table", "fdopen"),
    *("mkstemp", "NamedTemporaryFile", "rmtree", "rename", "hardlink_to", "symlink_to", "chmod"),
    *("copyfile", "copy2", "copyfileobj"),
}
"""Functions that write files, or change their places."""

OPENERS = {"open", "File", "ZipFile", "netcdf", "netcdf_file"}

ALLOWED = {
    "cnnum/cli/root.py": {"os.open"},  # /dev/null in place of a pipe that was closed
    # to drafts of the writer, and to memory
    "cnnum/design/sweeping.py": {"savez", "to_netcdf", "to_zarr"},
    "cnnum/engines/cache.py": {"rmtree"},  # what stands in the place of an entry
    "cnnum/engines/devices/child.py": {"NamedTemporaryFile"},  # a kernel, in /tmp
    "cnnum/engines/devices/listing.py": {"write_text", "symlink_to"},  # a folder for the loader
    "cnnum/engines/devices/pocl.py": {
        "os.open",
        "rmtree",
    },  # PoCL, its lock
    "cnnum/engines/devices/program_cache.py": {"ZipFile", "rmtree"},  # in memory; PoCL's own folder
    "cnnum/pictures.py": {"open"},  # films, into a draft of the writer
    "cnnum/recordings/journal.py": {"fdopen"},  # of a file that the writer has created
    "cnnum/recordings/lerobot.py": {"copyfile", "write_table"},  # into a draft of the writer
    "cnnum/recordings/export.py": {"File", "ZipFile", "open"},  # drafts of the writer
    "cnnum/report/plots.py": {"savefig"},  # to memory
    "cnnum/safety/reading.py": {"os.open", "fdopen"},  # to read
    "cnnum/scenes/loaded_export.py": {"write_text"},  # a source for the compiler, in /tmp
    "cnnum/scenes/processing.py": {"to_zarr", "write_table"},  # into a draft of the writer
    "cnnum/scenes/scene_record.py": {"savez_compressed", "netcdf"},  # to a draft; to memory
    "cnnum/tactile/cover/fem/generate.py": {"savez_compressed"},  # to a draft of the writer
    "drivers/virtual.py": {"symlink_to"},  # the name of a simulated port
}
"""The other places that may, and what for."""


def writing_calls(text: str) -> set[str]:
    found = set[str]()
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.Call):
            continue
        function = node.func
        name = getattr(function, "attr", getattr(function, "id", ""))
        given = [*node.args, *(word.value for word in node.keywords if word.arg == "mode")]
        modes = [one.value for one in given if isinstance(one, ast.Constant)]
        writes = any(
            isinstance(m, str) and set(m) <= set("rwaxbt+") and set(m) & set("wax+") for m in modes
        )
        if name in BY_NAME or (name in OPENERS and writes):
            found.add(name)
        elif name == "open" and getattr(getattr(function, "value", None), "id", "") == "os":
            found.add("os.open")
    return found


def test_no_other_file_writes():
    found = {}
    for room in ("cnnum", "drivers", "templates"):
        for path in sorted((ROOT / room).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            linked = name.startswith(("cnnum/drivers/", "cnnum/templates/"))
            if not linked and name != WRITER and (calls := writing_calls(path.read_text())):
                found[name] = calls
    assert found == ALLOWED


def test_the_search_sees_what_writes():
    seen = {
        "open(p, 'w')": "open",
        "p.open(mode='ab')": "open",
        "p.write_text(t)": "write_text",
        "os.open(p, os.O_WRONLY)": "os.open",
        "np.savez(p, a=a)": "savez",
        "h5py.File(p, 'w')": "File",
    }
    for text, name in seen.items():
        assert writing_calls(text) == {name}
    assert writing_calls("p.open('rb'); open(p); zipfile.ZipFile(p)") == set()


OWN_DATA = {
    "cnnum/design/sweeping.py",  # np.load of a file that open_regular gave
    "cnnum/embedded/c/files.py",  # a Makefile, once it is known to be a regular file
    "cnnum/engines/devices/pocl.py",  # /proc/self/maps
    "cnnum/engines/devices/selection.py",  # a kernel of the package
    "cnnum/engines/numba/compiling.py",  # the package's own sources
    "cnnum/engines/numba/printed.py",  # the source of its own printer
    "cnnum/engines/opencl/text.py",  # kernels of the package
    "cnnum/engines/notices.py",  # /proc/cpuinfo
    "cnnum/report/web_assembly.py",  # what the compiler has just written
    "cnnum/lab/bench/compile_time.py",  # a file that the benchmark has just written
    "cnnum/lab/embedded/cortex_m.py",  # what the compiler has just written
    "cnnum/lab/scoring/families/faces.py",  # a table of the package
    "cnnum/live/server.py",  # the page's own files
    "cnnum/report/gallery.py",
    "cnnum/report/html.py",
    "cnnum/report/sections.py",
    "cnnum/report/run_pages.py",
    "cnnum/safety/files.py",  # a draft of its own, and the head of a file once it is regular
    "cnnum/scenes/scene_file.py",  # a scene of the package
    "cnnum/tactile/cover/bump.py",  # tables of the package
    "cnnum/engines/devices/peak.py",
    "cnnum/recordings/hdf5_child.py",  # /proc/self/statm
    "drivers/own_data/sources.py",  # np.load of a file that open_regular gave
}
"""Files that read by other means, and what."""


def reading_calls(text: str) -> bool:
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.Call):
            continue
        function, given = node.func, [*node.args, *(word.value for word in node.keywords)]
        name = getattr(function, "attr", getattr(function, "id", ""))
        owner = getattr(getattr(function, "value", None), "id", "")
        modes = {one.value for one in given if isinstance(one, ast.Constant)}
        if name == "open" and modes & {"r", "rb", "rt"} and isinstance(function, ast.Attribute):
            return True
        of_path = isinstance(function, ast.Attribute)
        no_limit = not any(word.arg == "most" for word in node.keywords)
        if of_path and name in ("read_text", "read_bytes") and no_limit:
            return True
        if isinstance(function, ast.Name) and name == "open":
            return True
        if name == "load" and owner == "np":
            return True
    return False


def test_no_other_file_reads_what_users_name():
    found = set()
    for room in ("cnnum", "drivers", "templates"):
        for path in sorted((ROOT / room).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            linked = name.startswith(("cnnum/drivers/", "cnnum/templates/"))
            if not linked and reading_calls(path.read_text()):
                found.add(name)
    assert found == OWN_DATA
