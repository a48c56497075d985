"""The house itself: imports point one way, `import cnnum` is light, files stay small."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# A room may import from rooms on its own floor or below, never from above.
FLOORS = [
    ["errors"],
    ["arrays", "expressions", "files", "names", "reading", "toml_reading"],
    ["room"],
    ["boundary", "outputs", "frame", "tables"],
    ["couplings"],
    ["template"],
    ["network", "template_files"],
    ["graph", "library"],
    ["integrators"],
    ["tactile"],
    ["engines"],
    ["programs"],
    ["tracing"],
    ["plan", "stream"],
    ["runs"],
    ["engine"],
    ["checks"],
    ["templates"],
    ["program_library"],
    ["recordings"],
    ["drivers"],
    ["conversion", "dead_cells", "events", "frame_range", "scene", "scenes", "summary"],
    ["bad_frames", "histogram"],
    ["pipeline"],
    ["report", "bench", "reproduce", "viewer", "scoring"],
    ["cli"],
    ["__init__", "__main__"],
]
FLOOR = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
# what must know nothing of engines, so that checking against it means something
ORACLES = {"tactile", "checks"}
HEAVY = {
    "pyopencl": {"cnnum/engines/opencl"},
    "serial": {"drivers/serial_port.py"},
    "mcap": {"cnnum/recordings"},
    "zstandard": {"cnnum/recordings"},
    "lz4": {"cnnum/recordings"},
    "matplotlib": {"cnnum/report", "cnnum/lab/reproduce", "cnnum/lab/bench"},
    "numba": {"cnnum/engines/numba", "cnnum/lab/bench/peers"},
}


def sources():
    for folder in ("cnnum", "drivers", "templates"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            relative = path.relative_to(ROOT)
            if relative.parts[:2] not in {("cnnum", "drivers"), ("cnnum", "templates")}:
                yield path, relative


def room_of(relative):
    parts = relative.with_suffix("").parts
    return parts[0] if parts[0] in {"drivers", "templates"} else parts[1]


def imports_of(path):
    """Modules that a file imports when it is loaded or run, not those for type checkers alone."""
    tree = ast.parse(path.read_text())
    skipped = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if node in skipped:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


@pytest.mark.parametrize("relative", [r for _, r in sources()], ids=str)
def test_imports_point_one_way(relative):
    room = room_of(relative)
    for module in imports_of(ROOT / relative):
        if module.startswith("cnnum."):
            other = module.split(".")[1]
            assert FLOOR[other] <= FLOOR[room], f"{relative} imports {module}, from above"
            assert not (room in ORACLES and other in {"engines", "engine", "plan", "programs"})


@pytest.mark.parametrize("relative", [r for _, r in sources()], ids=str)
def test_heavy_libraries_stay_in_their_rooms(relative):
    for module in imports_of(ROOT / relative):
        allowed = HEAVY.get(module.split(".")[0])
        if allowed is not None:
            assert any(relative.as_posix().startswith(room) for room in allowed), (
                f"{relative}: {module}"
            )


@pytest.mark.parametrize("relative", [r for _, r in sources()], ids=str)
def test_files_and_functions_stay_small(relative):
    text = (ROOT / relative).read_text()
    assert len(text.splitlines()) <= 400
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            lines = (
                node.end_lineno
                - node.lineno
                + 1
                - len((ast.get_docstring(node) or "").splitlines())
            )
            assert lines <= 60, f"{relative}:{node.lineno} {node.name} has {lines} lines"


def test_every_room_has_a_floor():
    assert {room_of(relative) for _, relative in sources()} <= set(FLOOR)


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
    assert libraries("import cnnum; dir(cnnum); assert cnnum.__all__") <= {"numpy"}
    assert libraries("import cnnum; cnnum.Template") == {"numpy"}
    # this would see what is heavy
    assert {"scipy", "numpy"} <= libraries("import cnnum; import scipy.optimize")


def test_naming_the_engine_is_light():
    """The engine that is asked for brings its own libraries, and no other's."""
    assert libraries("import cnnum; cnnum.Engine, cnnum.Plan, cnnum.program") == {"numpy"}
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
    assert set(cnnum._HOME) | {"tactile", "__version__"} == set(cnnum.__all__)


def test_public_names_can_all_be_had():
    import cnnum

    for name in cnnum.__all__:
        assert getattr(cnnum, name) is not None
    rooms = {path.stem for path in (ROOT / "cnnum").iterdir()} - {"__init__", "__main__", "tactile"}
    assert not rooms & set(cnnum.__all__), "a room and a public name must not share a name"
