"""All that is written goes through `cnnum.safety.files`; nothing else opens a file to write."""

import ast
from pathlib import Path

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
    "cnnum/design/chunk_store.py": {"savez"},  # to a draft of the writer
    "cnnum/design/sweeping.py": {"to_netcdf", "to_zarr"},  # to memory; to a draft of the writer
    "cnnum/engines/cache.py": {"rmtree"},  # what stands in the place of an entry
    "cnnum/engines/devices/device_trouble.py": {"NamedTemporaryFile"},  # a kernel, in /tmp
    "cnnum/engines/devices/pocl_folder.py": {
        "os.open",
        "rmtree",
    },  # PoCL, its lock
    "cnnum/engines/devices/program_cache.py": {"ZipFile", "rmtree"},  # in memory; PoCL's own folder
    "cnnum/recordings/chunk_file.py": {"fdopen"},  # of a file that the writer has created
    "cnnum/recordings/hdf5_writer.py": {"File"},  # into a draft of the writer
    "cnnum/recordings/lerobot.py": {"write_table"},  # into a draft of the writer
    "cnnum/recordings/npz_writer.py": {"ZipFile", "open"},  # members of a draft of the writer
    "cnnum/report/probe_picture.py": {"savefig"},  # to memory
    "cnnum/safety/reading.py": {"os.open", "fdopen"},  # to read
    "cnnum/scenes/scene_record.py": {"savez_compressed", "netcdf"},  # to a draft; to memory
    "cnnum/tactile/cover/fem/generate.py": {"savez_compressed"},  # to a draft of the writer
    "drivers/virtual/line.py": {"symlink_to"},  # the name of a simulated port
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
