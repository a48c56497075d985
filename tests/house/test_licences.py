"""Licences: the table has every locked package, and no module imports one for tests."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "docs" / "licences.md"
FOR_TESTS = {
    *("tamaas", "ContactMechanics", "SurfaceTopography", "muGrid", "NuMPI", "mpmath", "igor2"),
    *("flint", "unicorn"),
    *("hypothesis", "pytest", "xdist", "mypy", "build"),
}
"""Modules that are installed for tests alone; tamaas is under the AGPL."""


def normal(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def rows():
    """Package to licence and use."""
    lines = [line for line in TABLE.read_text().splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[1:]]
    return {
        normal(name): (licence, use) for names, licence, use in cells for name in names.split(", ")
    }


def modules(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.split(".")[0]


def test_every_locked_package_is_in_the_table():
    lock = (ROOT / "requirements.lock").read_text().splitlines()
    locked = {
        normal(re.split(r"[=<>@ ;]", line)[0]) for line in lock if line and line[0] not in "# "
    }
    assert len(locked) > 50
    assert locked <= set(rows()), sorted(locked - set(rows()))
    assert all(licence and use for licence, use in rows().values())


def test_no_runtime_package_is_under_a_copyleft_licence_alone():
    for name, (licence, use) in rows().items():
        if use == "runtime":
            assert "GPL" not in licence or " OR " in licence, f"{name}: {licence}"
    assert "AGPL" in rows()["tamaas"][0]
    assert rows()["tamaas"][1].startswith("tests only")


@pytest.mark.parametrize("folder", ["cnnum", "drivers", "templates"])
def test_no_module_imports_what_is_for_tests(folder):
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    for path in files:
        found = FOR_TESTS & set(modules(path))
        assert not found, f"{path.relative_to(ROOT)} imports {found}"
