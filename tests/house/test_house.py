"""The house itself: imports point one way, and `import cnnum` is light."""

import ast
import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]

# knows nothing of engines, so that checking against it means something
ORACLES = {"tactile", "templating.checks"}
MACHINE = {"engines", "engine", "plan", "programs"}
HEAVY = {
    "pyopencl": {
        "cnnum/engines/opencl",
        "cnnum/engines/devices",
        "cnnum/engines/fixed_point/device_frames.py",
        "cnnum/lab/bench",
    },
    "serial": {"drivers/serial_port.py"},
    "mcap": {"cnnum/recordings"},
    "zstandard": {"cnnum/recordings"},
    "lz4": {"cnnum/recordings"},
    "websockets": {"drivers/serial_port.py", "cnnum/live"},
    "rerun": {"cnnum/live/rerun_sink.py"},
    "foxglove": {"cnnum/live/foxglove_sink.py"},
    "rclpy": {"cnnum/live/ros_sink.py"},
    "matplotlib": {"cnnum/report", "cnnum/lab"},
    "PIL": {"cnnum/pictures.py", "cnnum/report"},
    "numba": {"cnnum/design", "cnnum/engines/numba", "cnnum/lab/bench/peers"},
}

NO_NOUNS = {"one", "each", "found", "about", "asked"}
PRIVATE = {"moves", "loosens", "jolt", "grows", "sticks", "lies", "shows"}
CLEAR = ("cnnum/kernels", "cnnum/graph", "cnnum/engines/opencl", "cnnum/embedded/lowering")
"""Where values are called by what they hold."""


def load(path):
    """A script of the docs as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


HOUSE = load(ROOT / "docs/figures/house.py")
FLOOR, sources, imports_of, own_room = (
    HOUSE.FLOOR,
    HOUSE.sources,
    HOUSE.imports_of,
    HOUSE.own_room,
)


def test_every_room_has_a_floor():
    assert {own_room(relative) for _, relative in sources()} == set(FLOOR)


def test_imports_point_one_way():
    wrong = []
    for path, relative in sources():
        room = own_room(relative)
        for module in imports_of(path):
            other = HOUSE.rooms_of(module)
            if other and (FLOOR[other] > FLOOR[room] or (room in ORACLES and other in MACHINE)):
                wrong.append(f"{relative} imports {module}")
    assert not wrong


def test_nothing_imports_the_lab():
    """The floors say so as well; here no import in a function or by its name slips through."""
    naming = {
        relative.as_posix()
        for path, relative in sources()
        if own_room(relative) != "lab" and "cnnum.lab" in path.read_text()
    }
    assert naming == {"cnnum/cli/root.py"}


def test_all_else_runs_without_the_lab(tmp_path):
    """A folder of the package without `lab`: nothing is missed but the commands that live there."""
    for folder, source in (("", "cnnum"), ("drivers", "drivers"), ("templates", "templates")):
        ignored = ["__pycache__", *([] if folder else ["lab", "drivers", "templates"])]
        shutil.copytree(
            ROOT / source, tmp_path / "cnnum" / folder, ignore=shutil.ignore_patterns(*ignored)
        )
    assert not (tmp_path / "cnnum" / "lab").exists()

    def run(*arguments):
        return subprocess.run(
            [sys.executable, "-m", "cnnum", *arguments],
            capture_output=True,
            text=True,
            cwd=tmp_path,
        )

    helped = run("--help")
    assert helped.returncode == 0
    assert "templates" in helped.stdout
    assert "bench" not in helped.stdout
    assert (refused := run("bench")).returncode == 2
    assert "Unknown command 'bench'" in refused.stderr
    for arguments in (
        ("run", "contact", "--frames", "60"),
        ("templates", "check", "EDGE"),
    ):
        done = run(*arguments)
        assert done.returncode == 0, (arguments, done.stderr)
        assert done.stdout
    modules = [
        ".".join(relative.with_suffix("").parts)
        for _, relative in sources()
        if own_room(relative) != "lab" and relative.parts[0] == "cnnum"
    ]
    importing = f"import importlib; [importlib.import_module(m) for m in {modules} if m[-1] != '_']"
    subprocess.run([sys.executable, "-c", importing], check=True, cwd=tmp_path)


def test_the_page_draws_the_house_as_it_is():
    assert HOUSE.PICTURE.read_text() == HOUSE.picture()
    assert HOUSE.PAGE.read_text() == HOUSE.page(HOUSE.PAGE.read_text())
    assert HOUSE.table() in HOUSE.PAGE.read_text()


def test_heavy_libraries_stay_in_their_rooms():
    wrong = [
        f"{relative} imports {module}"
        for path, relative in sources()
        for module in imports_of(path)
        if (rooms := HEAVY.get(module.split(".")[0]))
        and not any(relative.as_posix().startswith(room) for room in rooms)
    ]
    assert not wrong


def own_names(path):
    """The names and lines of parameters and of all that is assigned."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.arg):
            yield node.arg, node.lineno
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id, node.lineno


def test_values_are_called_by_what_they_hold():
    wrong = {
        f"{relative}:{line}: {name}"
        for path, relative in sources()
        if relative.as_posix().startswith(CLEAR)
        for name, line in own_names(path)
        if name in NO_NOUNS | PRIVATE
    }
    assert not wrong


def loaded_by(code):
    """Top-level libraries, and their submodules, that Python loads for some code of a user's."""
    printed = f"import sys; before = set(sys.modules); {code}; print(*set(sys.modules) - before)"
    command = [sys.executable, "-c", printed]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    *_, loaded = done.stdout.splitlines()
    ours = {*sys.stdlib_module_names, "cnnum"}
    return {module for module in loaded.split() if module.split(".")[0] not in ours}


def libraries(code):
    return {module.split(".")[0] for module in loaded_by(code)}


def test_import_is_light():
    """`import cnnum` and naming public things needs NumPy alone."""
    assert libraries("import cnnum; dir(cnnum); assert cnnum.__all__") <= {"numpy", "lazy_loader"}
    assert libraries("import cnnum; cnnum.Template") == {"numpy", "lazy_loader"}
    # this would see a heavy library
    assert {"scipy", "numpy"} <= libraries("import cnnum; import scipy.optimize")


def test_naming_the_engine_is_light():
    """The engine that is asked for brings its own libraries, and no other's."""
    assert libraries("import cnnum; cnnum.Engine, cnnum.Plan, cnnum.program") == {
        "numpy",
        "lazy_loader",
    }
    reference = libraries("import cnnum; cnnum.Engine('reference')")
    assert "scipy" in reference
    assert not reference & {"pyopencl", "numba", "matplotlib", "click", "rich", "serial"}


def test_public_names_are_named():
    import cnnum

    code = "import cnnum; print(*dir(cnnum))"
    command = [sys.executable, "-c", code]
    named = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout
    assert set(cnnum.__all__) <= set(named.split())
    assert {"Engine", "Template", "program", "tactile", "__version__"} <= set(named.split())


def test_public_names_can_all_be_had():
    import cnnum

    for name in cnnum.__all__:
        assert getattr(cnnum, name) is not None
    rooms = {path.stem for path in (ROOT / "cnnum").iterdir()} - {"__init__", "__main__", "tactile"}
    assert not rooms & set(cnnum.__all__), "a room and a public name must not share a name"
