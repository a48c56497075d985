"""The wheel holds every module and data file, and installs nothing but `cnnum`."""

import ast
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SHIPPED = {".py", ".pyi", ".toml", ".cl", ".css", ".js", ".html", ".npz"}


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A copy of the files that git would hand out: no caches, links kept as links."""
    source = tmp_path_factory.mktemp("source")
    for line in subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.splitlines():
        target = source / line
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / line).is_symlink():
            target.symlink_to((ROOT / line).readlink())
        elif (ROOT / line).exists():
            target.write_bytes((ROOT / line).read_bytes())
    return source


@pytest.fixture(scope="module")
def wheel(tmp_path_factory, source):
    return built_of(source, tmp_path_factory.mktemp("wheel"), "wheel")


def built_of(source, out, kind):
    subprocess.run(
        [sys.executable, "-m", "build", f"--{kind}", "--outdir", out, source],
        check=True,
        capture_output=True,
    )
    (built,) = out.glob("*.whl" if kind == "wheel" else "*.tar.gz")
    return built


def modules_in(folder, package):
    return {
        f"{package}/{path.relative_to(folder).as_posix()}"
        for path in folder.rglob("*")
        if path.suffix in SHIPPED and "__pycache__" not in path.parts
    }


def test_wheel_holds_every_module_and_data_file_once(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    inside = {n for n in names if n.startswith("cnnum/") and Path(n).suffix in SHIPPED}
    expected = (
        {
            n
            for n in modules_in(ROOT / "cnnum", "cnnum")
            if n.split("/")[1] not in {"drivers", "templates"}
        }
        | modules_in(ROOT / "drivers", "cnnum/drivers")
        | modules_in(ROOT / "templates", "cnnum/templates")
    )
    assert inside == expected
    assert len(names) == len(set(names))


def test_wheel_leaks_no_other_top_level_name(wheel):
    top = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert {name for name in top if not name.endswith(".dist-info")} == {"cnnum"}


def test_installed_wheel_runs_from_any_folder(wheel, tmp_path):
    """Installed without the checkout, the library and the drivers are found."""
    home = tmp_path / "env"
    venv.create(home, with_pip=False, system_site_packages=False)
    site = next(home.glob("lib/python*/site-packages"))
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    # the dependencies of this environment, without the checkout's own editable install
    here = next(p for p in map(Path, sys.path) if p.name == "site-packages")
    (site / "dependencies.pth").write_text(f"{here}\n")
    code = (
        "import cnnum, cnnum.drivers.registry as r; "
        "print(cnnum.__file__); print(len(cnnum.template_names())); print(r.driver_names())"
    )
    done = subprocess.run(
        [home / "bin/python", "-E", "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    where, count, drivers = done.stdout.splitlines()
    assert Path(where).is_relative_to(home)
    assert int(count) >= 12
    assert "simulated" in drivers


def missing_extras():
    """The library and the extra that each sentence on a missing library names."""
    for folder in ("cnnum", "drivers", "templates"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "missing_extra":
                    yield node.args[1], node.args[2]


def test_sentences_name_extras_that_bring_the_library():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    constants = [
        (library.value, extra.value)
        for library, extra in missing_extras()
        if isinstance(library, ast.Constant) and isinstance(extra, ast.Constant)
    ]
    assert len(constants) > 8
    for library, extra in constants:
        brought = {re.split(r"[\[>=<;]", item)[0].lower() for item in extras[extra]}
        assert library.lower() in brought, f"extra '{extra}' does not bring {library}"


def test_no_page_or_sentence_installs_a_stranger():
    """On the package index 'cnnum' is another project, so nothing may say to install that."""
    own = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["name"]
    assert own == "cnnum-emulator"
    stranger = re.compile(r"pip3? install ['\"]?cnnum(?!-emulator|/)\b|\bcnnum\[")
    named = subprocess.run(
        ["git", "ls-files", "*.py", "*.md", "*.toml", "*.yml", "Makefile"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    pages = [ROOT / name for name in named if not name.startswith("tests/")]
    assert len(pages) > 400
    assert not [path.name for path in pages if stranger.search(path.read_text())]
    assert stranger.search("pip install cnnum")
    assert stranger.search("pip install 'cnnum[view]'")


def test_conda_has_the_dependencies_of_pip():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = {item.split(";")[0] for item in project["dependencies"]}
    wheel = {item for item in asked if item.startswith("pocl-binary-distribution")}
    text = (ROOT / "docs/environment.yml").read_text()
    items = [line.strip() for line in text.splitlines() if line.startswith("  ")]
    listed = {item[2:] for item in items if item.startswith("- ")}
    # "pip:" opens the list of packages that conda leaves to pip
    own = {"conda-forge", "pip", "pip:", "pocl", f"python{project['requires-python']}"}
    assert listed == (asked - wheel) | own


def test_lock_file_pins_every_dependency():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    locked = {
        line.split("==")[0].lower().replace("_", "-")
        for line in (ROOT / "requirements.lock").read_text().splitlines()
    }
    asked = [*project["dependencies"]]
    for extra in project["optional-dependencies"].values():
        asked += [item for item in extra if not item.startswith("cnnum-emulator[")]
    names = {item.split(">=")[0].split("[")[0].lower() for item in asked}
    assert names <= locked


@pytest.mark.promise("Locked packages are installed by their hashes.")
def test_lock_file_has_hashes_of_every_package_and_its_sections():
    """pip refuses a lock in which one package has no hash; make reads the file by its sections."""
    text = (ROOT / "requirements.lock").read_text()
    entries = re.split(r"\n(?! )", text)
    packages = [entry for entry in entries if entry and not entry.startswith("#")]
    assert len(packages) > 100
    for entry in packages:
        head, *hashes = entry.split(" \\\n    ")
        assert re.fullmatch(r"[\w.-]+==[\w.+!]+( ; .+)?", head), head
        assert hashes
        assert all(re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", each) for each in hashes), head
    lines = text.splitlines()
    places = [
        lines.index(title)
        for title in ("# to run:", "# to develop and test:", "# of other extras:")
    ]
    assert places == sorted(places)
    run = [line.partition("==")[0] for line in lines[places[0] : places[1]] if "==" in line]
    assert {"numpy", "pyopencl", "setuptools"} <= set(run)
    assert not {"pytest", "mypy"} & set(run)
    makefile = (ROOT / "Makefile").read_text()
    assert "--require-hashes" in makefile
    for title in ("to develop and test", "of other extras"):
        assert f"$(call LOCKED,{title})" in makefile


FRAME = """
import sys
sys.path[0:0] = [sys.argv[1]]
import cnnum
from cnnum.cli import main
from cnnum.drivers import open_driver
assert cnnum.__file__.startswith(sys.argv[1])
frame = next(open_driver("simulated", {}).frames())
assert frame.values.shape == (8, 8, 4), frame.values.shape
sys.argv[1:] = ["templates", "show", "EDGE"]
main()
"""


def answer_of(folder):
    """What a tree prints that reads a template, and opens a driver."""
    command = [sys.executable, "-P", "-c", FRAME, str(folder)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "EDGE" in done.stdout


def test_an_unpacked_source_archive_runs_and_is_whole(source, tmp_path_factory):
    archive = built_of(source, tmp_path_factory.mktemp("sdist"), "sdist")
    place = tmp_path_factory.mktemp("unpacked")
    with tarfile.open(archive) as held:
        held.extractall(place, filter="data")
    (folder,) = place.iterdir()
    assert not (folder / "cnnum" / "drivers").exists()
    answer_of(folder)
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    # those that git has: another test may have files here for a moment
    listed = subprocess.run(
        ["git", "ls-files", "--cached"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.splitlines()
    whole = {name for name in listed if (source / name).is_file()}
    links = {"cnnum/drivers", "cnnum/templates"}
    assert {name for name in whole - names if not name.startswith(tuple(links))} == set()


def test_a_checkout_without_symbolic_links_runs(source, tmp_path):
    """As git makes it on Windows: a link is a small file that holds its target."""
    shutil.copytree(source, tmp_path / "plain", symlinks=True)
    for name in ("drivers", "templates"):
        link = tmp_path / "plain" / "cnnum" / name
        target = str(link.readlink())
        link.unlink()
        link.write_text(target)
    answer_of(tmp_path / "plain")
