"""Every writer of the project on a full disk, over files of others, and where no file can be."""

import contextlib
import dataclasses
import os
import resource
import shutil
import stat
import tempfile
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import click
import numpy as np
import pytest
from click.testing import CliRunner

import cnnum
from cnnum.cli import main
from cnnum.cli.commands.record import Recorder
from cnnum.drivers.registry import open_driver
from cnnum.embedded.c.files import Exported
from cnnum.embedded.c.vector import Vector
from cnnum.errors import CnnumError, ReportError
from cnnum.frame import Frame
from cnnum.lab.bench import page as bench_page
from cnnum.lab.bench.records import append_row, data_text
from cnnum.lab.reproduce import page as reproduce_page
from cnnum.lab.scoring import page as scoring_page
from cnnum.lab.stability import page as stability_page
from cnnum.report import gallery, html, plots, run_pages, sections, sweep_page
from cnnum.report.run_pages import write_trace_page
from cnnum.safety import files
from cnnum.scenes.frame_path import FrameResult
from cnnum.scenes.scene_record import SceneRecord
from cnnum.tactile.cover.fem import generate
from cnnum.tactile.taxel import Calibration

PRECIOUS = b"precious\n" * 20
ROOM = 64
"""Bytes that a file may have on the full disk: less than any output has."""

LONG = "x" * 10_000
EMPTY = Vector((), (), (), (), False, 0, 0, {})


@cache
def recording():
    values = np.random.default_rng(1).normal(size=(20, 3, 4, 3))
    return cnnum.Recording(values, rate=100.0)


@cache
def transient():
    engine = cnnum.Engine("numba")
    return run_pages.transient_of(
        engine, cnnum.get_template("EDGE"), run_pages.default_picture(), 3
    )


@cache
def dataset():
    xarray = pytest.importorskip("xarray", reason="the extra 'tables' is not installed")
    return xarray.Dataset({"flipped": (("size",), np.arange(50.0))}, attrs={"template": "HOLE"})


def fields(target, *, force):
    record = SceneRecord(["load"])
    for n in range(50):
        shown = Frame(np.zeros((3, 4, 1)), ("normal",), "N", n, 0.01 * n)
        load = {"load": np.full((3, 4), float(n))}
        record.add(FrameResult(n, shown, shown.values, load, (), 0.0))
    record.save(target, force=force)


def transient_to(target, *, force):
    times, result = transient()
    run_pages.write_transient(target, cnnum.get_template("EDGE"), times, result, force=force)


def sweep_to(target, *, force):
    from cnnum.design import sweeping

    sweeping.refuse_results(target, force=force)
    sweeping._write(dataset(), target, force=force)


def paged(module, name, call):
    """A writer of a page, whose text is made up: what is tried is the writing."""

    def run(target, *, force):
        with mock.patch.object(module, name, return_value=LONG):
            call(target, force=force)

    return run


def recorded(target, *, force):
    with open_driver("simulated") as driver:
        recorder = Recorder(target, driver, force=force)
        for frame in recording().frames():
            recorder.add(frame)
    outcome = recorder.finish()
    if outcome.problem:
        raise ReportError(outcome.problem)


WRITERS = {
    **{
        f"save_template {suffix}": (
            suffix,
            lambda target, *, force: cnnum.save_template(
                cnnum.get_template("EDGE"), target, force=force
            ),
        )
        for suffix in (".toml", ".tem", ".m", ".cnnsim")
    },
    "save_picture": (
        ".png",
        lambda target, *, force: cnnum.save_picture(np.eye(40), target, force=force),
    ),
    **{
        f"save_film {suffix}": (
            suffix,
            lambda target, *, force: cnnum.save_film(np.ones((2, 8, 8)), target, force=force),
        )
        for suffix in (".gif", ".mp4", ".webm")
    },
    **{
        f"Recording.save {suffix}": (
            suffix,
            lambda target, *, force: recording().save(target, force=force),
        )
        for suffix in (".mcap", ".npz", ".csv", ".h5")
    },
    **{f"cnnum record {suffix}": (suffix, recorded) for suffix in (".mcap", ".npz")},
    **{f"SceneRecord.save {suffix}": (suffix, fields) for suffix in (".npz", ".csv", ".nc")},
    "Calibration.save": (
        ".toml",
        lambda target, *, force: Calibration(alpha_normal=1.0).save(target, force=force),
    ),
    **{f"transient {suffix}": (suffix, transient_to) for suffix in (".html", ".png", ".gif")},
    "trace": (
        ".html",
        lambda target, *, force: write_trace_page(target, "t", (), force=force),
    ),
    "demo": (
        ".html",
        paged(
            sections,
            "page",
            lambda target, *, force: sections.write_demo_report(
                target, SimpleNamespace(frames=1, name="x"), force=force
            ),
        ),
    ),
    "reproduce": (
        ".html",
        paged(
            reproduce_page,
            "page",
            lambda target, *, force: reproduce_page.write_page(target, (), (), force=force),
        ),
    ),
    "score": (
        ".html",
        paged(
            scoring_page,
            "page",
            lambda target, *, force: scoring_page.write_page(target, (), None, None, force=force),
        ),
    ),
    "stability": (
        ".html",
        paged(
            stability_page,
            "page",
            lambda target, *, force: stability_page.write_page(target, (), force=force),
        ),
    ),
    "sweep --page": (
        ".html",
        paged(
            sweep_page,
            "page",
            lambda target, *, force: sweep_page.write_page(target, None, force=force),
        ),
    ),
    "gallery": (".html", lambda target, *, force: files.write_whole(target, LONG, force=force)),
    "sweep": (".nc", sweep_to),
    "probe --picture": (
        ".png",
        lambda target, *, force: plots.draw(
            target, {"rest": np.zeros((3, 4, 1))}, ("z",), "V", force=force
        ),
    ),
    "fem tables": (
        ".npz",
        lambda target, *, force: generate._write(target, {"depths": np.zeros(9)}, force=force),
    ),
}
"""Every writer of one file: its suffix, and a call with a target."""


def export_to(target, *, force):
    Exported({"a.c": LONG, "b.h": LONG}, 0, 0, 0, 0, EMPTY, None, None).write(target, force=force)


def bench_to(target, *, force):
    rows = [{"case": "one", "value": 1.0}]
    append_row(target, "latency", rows, force=force)
    with (
        mock.patch.object(bench_page, "_page", return_value=LONG),
        mock.patch.object(bench_page, "png", return_value=LONG.encode()),
        mock.patch.dict(bench_page.CHARTS, {"latency": lambda _: None}),
    ):
        bench_page.write_report(target, "latency", rows, "d", [], force=force)


def zarr_to(target, *, force):
    pytest.importorskip("zarr", reason="the extra 'zarr' is not installed")
    sweep_to(target, force=force)


FOLDERS = {
    "export": ("", export_to, "a.c"),
    "bench": ("", bench_to, "latency.json"),
    "sweep": (".zarr", zarr_to, "zarr.json"),
}
"""Every writer of a folder: its suffix, a call, and one of its files."""


@contextlib.contextmanager
def full_disk():
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@contextlib.contextmanager
def umask(value):
    before = os.umask(value)
    try:
        yield
    finally:
        os.umask(before)


@pytest.fixture
def folder():
    """A folder that another user can read."""
    path = Path(tempfile.mkdtemp(prefix="cnnum-writers-"))
    path.chmod(0o755)
    yield path
    path.chmod(0o755)
    shutil.rmtree(path)


@contextlib.contextmanager
def read_only(folder):
    """A folder that cannot be written, by root neither."""
    before = os.geteuid()
    folder.chmod(0o555)
    if before == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(before)


def tree(folder):
    """All that is in a folder, by name: kind, mode and content."""
    found = {}
    for path in sorted(folder.rglob("*")):
        status = path.lstat()
        regular = stat.S_ISREG(status.st_mode)
        found[path.relative_to(folder)] = status.st_mode, path.read_bytes() if regular else b""
    return found


def refused(call, target, *, force, why=""):
    """Return why a call has not ended in one sentence of ours; nothing where it has."""
    try:
        call(target, force=force)
    except CnnumError as error:
        said = str(error)
        return "" if why in said and "\n" not in said else f"said {said}"
    except Exception as error:
        return f"raised {error!r}"
    return "wrote"


def in_the_way(kind, target):
    """Put something at a target, and return what the error must say."""
    if kind == "file":
        target.write_bytes(PRECIOUS)
        return "already exists"
    if kind == "folder":
        target.mkdir()
        (target / "mine").write_bytes(PRECIOUS)
        return "folder"
    if kind == "pipe":
        os.mkfifo(target)
        return "a pipe"
    if kind == "node":
        target.symlink_to("/dev/null")
        return "a device"
    target.symlink_to("/dev/stdout")
    return "an open stream"


KINDS = ("file", "folder", "pipe", "node", "stream")


def test_writers_leave_what_is_theirs_to_others(faults, folder):
    """A file, a folder, a pipe, a device or an open stream in the way of a writer stays."""
    cases = [(name, kind) for name in WRITERS for kind in KINDS]
    for name, kind in faults.each(cases, short=len(cases)):
        suffix, call = WRITERS[name]
        target = folder / f"out{suffix}"
        why = in_the_way(kind, target)
        before = tree(folder)
        for force in (False, True)[: 1 if kind == "file" else 2]:
            problem = refused(call, target, force=force, why=why)
            if problem or tree(folder) != before:
                faults.lose(f"{name} over a {kind}: {problem or 'changed it'}")
        shutil.rmtree(target) if target.is_dir() else target.unlink()


def test_a_full_disk_leaves_the_old_file_or_none(faults, folder):
    """On a full disk, and in a folder that is read-only, a writer leaves the old file or none."""
    cases = [(name, old) for name in WRITERS for old in (False, True)]
    for name, old in faults.each(cases, short=len(cases)):
        suffix, call = WRITERS[name]
        target = folder / f"out{suffix}"
        if old:
            target.write_bytes(PRECIOUS)
        before = tree(folder)
        call_now = partial(refused, call, target, force=old)
        with full_disk():
            problem = call_now()
        if problem or tree(folder) != before:
            faults.lose(f"{name} on a full disk: {problem or tree(folder).keys()}")
        with read_only(folder):
            problem = call_now(why="cannot be written")
        folder.chmod(0o755)
        if problem or tree(folder) != before:
            faults.lose(f"{name} in a read-only folder: {problem or tree(folder).keys()}")
        target.unlink(missing_ok=True)


def test_modes_are_kept_and_the_umask_is_heeded(faults, folder):
    """A new file has the mode that the umask leaves; one that is replaced keeps its own."""
    for name in faults.each(list(WRITERS), short=len(WRITERS)):
        suffix, call = WRITERS[name]
        new, old = folder / f"new{suffix}", folder / f"old{suffix}"
        old.write_bytes(PRECIOUS)
        for mask, mode in ((0o077, 0o600), (0o022, 0o644), (0o002, 0o664)):
            with umask(mask):
                call(new, force=False)
            if stat.S_IMODE(new.stat().st_mode) != mode:
                faults.lose(f"{name}: {new.stat().st_mode:o} under the umask {mask:o}")
            new.unlink()
        for mode in (0o600, 0o640, 0o444):
            old.chmod(mode)
            with umask(0o022):
                call(old, force=True)
            if stat.S_IMODE(old.stat().st_mode) != mode or old.read_bytes() == PRECIOUS:
                faults.lose(f"{name}: {old.stat().st_mode:o} instead of {mode:o}")
        for each in (old, *folder.iterdir()):  # the calibration of a table stands beside it
            each.unlink(missing_ok=True)


def test_a_link_is_followed_and_a_long_name_is_taken(faults, folder):
    """A link stays one: the file that it leads to is replaced. A name of 255 bytes is written."""
    for name in faults.each(list(WRITERS), short=len(WRITERS)):
        suffix, call = WRITERS[name]
        real, link = folder / "real", folder / f"link{suffix}"
        real.write_bytes(PRECIOUS)
        link.symlink_to(real)
        if problem := refused(call, link, force=False, why="already exists"):
            faults.lose(f"{name} over a link: {problem}")
        call(link, force=True)
        if not link.is_symlink() or real.read_bytes() == PRECIOUS:
            faults.lose(f"{name} did not follow the link")
        link.unlink()
        call(folder / f"{'n' * (255 - len(suffix))}{suffix}", force=False)
        for each in folder.iterdir():
            each.unlink()


def test_folders_of_others_are_never_emptied(faults, folder):
    """A folder with other files keeps them, whatever is written to it, and so does a full disk."""
    for name in faults.each(list(FOLDERS), short=len(FOLDERS)):
        suffix, call, one = FOLDERS[name]
        target = folder / f"out{suffix}"
        target.mkdir()
        (target / "mine").write_bytes(PRECIOUS)
        (target / one).write_bytes(PRECIOUS)
        before = tree(folder)
        problem = refused(call, target, force=False)
        (target / "latency.jsonl").unlink(missing_ok=True)  # rows are kept while it runs
        if problem or tree(folder) != before:
            faults.lose(f"{name} over a folder: {problem or tree(folder).keys()}")
        with full_disk():
            problem = refused(call, target, force=True)
        (target / "latency.jsonl").unlink(missing_ok=True)
        if problem or tree(folder) != before:
            faults.lose(f"{name} on a full disk: {problem or tree(folder).keys()}")
        with contextlib.suppress(CnnumError):
            call(target, force=True)
        if (target / "mine").read_bytes() != PRECIOUS:
            faults.lose(f"{name} has removed a file")
        shutil.rmtree(target)
        target.write_bytes(PRECIOUS)
        if refused(call, target, force=True) or target.read_bytes() != PRECIOUS:
            faults.lose(f"{name} over a file")
        target.unlink()
        with read_only(folder):
            if problem := refused(call, target, force=False):
                faults.lose(f"{name} in a read-only folder: {problem}")
        folder.chmod(0o755)


def test_a_zarr_folder_of_its_own_is_replaced_as_a_whole(tmp_path):
    pytest.importorskip("zarr", reason="the extra 'zarr' is not installed")
    target = tmp_path / "out.zarr"
    sweep_to(target, force=False)
    assert "already exists" not in refused(sweep_to, target, force=True)
    assert refused(sweep_to, target, force=False, why="already exists") == ""
    before = tree(tmp_path)
    with full_disk():
        assert refused(sweep_to, target, force=True) == ""
    assert tree(tmp_path) == before
    (target / "flipped" / "mine").write_bytes(PRECIOUS)
    assert refused(sweep_to, target, force=True, why="holds other files") == ""


@contextlib.contextmanager
def meanwhile(change):
    """Change something while a writer brings its draft to the disk, just before it is moved."""
    real, done = os.fsync, []

    def fsync(handle):
        if not done:
            done.append(True)
            change()
        real(handle)

    with mock.patch.object(os, "fsync", fsync):
        yield
    assert done, "nothing was brought to the disk"


def come(kind, target):
    """Put something of others in the place of whatever is there."""
    if target.is_dir():
        shutil.rmtree(target)
    target.unlink(missing_ok=True)
    if kind == "link":
        target.with_name("elsewhere").write_bytes(PRECIOUS)
        target.symlink_to(target.with_name("elsewhere"))
    else:
        in_the_way(kind, target)


def without_drafts(folder):
    return {name: what for name, what in tree(folder).items() if files.DRAFT not in str(name)}


REPORTS = {
    ".html": b'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
    b'<meta name="generator" content="cnnum"><title>ours',
    ".png": b"\x89PNG\r\n\x1a\n" + bytes(25) + b"\0\0\0\x0etEXtSoftware\0cnnum1234",
}
"""Beginnings of reports that may be written again without being asked."""


def test_what_comes_while_a_writer_works_is_kept(faults, folder):
    """A file, link, folder or pipe that comes to its place while a writer works stays as it is."""
    # a recorder's own file stands there from the first frame on
    names = [name for name in WRITERS if not name.startswith("cnnum record")]
    cases = [
        (name, kind, ours)
        for name in names
        for kind in ("file", "link", "folder", "pipe")
        for ours in (False, True)
        if not ours or WRITERS[name][0] in REPORTS
    ]
    for name, kind, ours in faults.each(cases, short=70):
        suffix, call = WRITERS[name]
        target, after = folder / f"out{suffix}", []
        if ours:
            target.write_bytes(REPORTS[suffix])

        def change(kind=kind, target=target, after=after):
            come(kind, target)
            after.append(without_drafts(folder))

        with meanwhile(change):
            problem = refused(call, target, force=False)
        if problem or tree(folder) != after[0]:
            faults.lose(f"{name}, a {kind}: {problem or 'changed it'}")
        for each in folder.iterdir():
            shutil.rmtree(each) if each.is_dir() and not each.is_symlink() else each.unlink()


def test_folders_and_files_that_come_while_a_folder_is_filled_are_kept(faults, folder):
    """What comes to a folder's place, or into the old folder, while a new one is filled stays."""
    target = folder / "out"

    def owns(place):
        return all(path.name == "own" for path in place.iterdir())

    def add(name):
        return lambda: (target / name).write_bytes(PRECIOUS)

    changes = {
        **{kind: partial(come, kind, target) for kind in ("file", "link", "folder", "pipe")},
        "one of ours": lambda: (target.mkdir(exist_ok=True), add("own")()),
        "a file in it": lambda: (target.mkdir(exist_ok=True), add("mine")()),
    }
    cases = [(old, change) for old in ("", "empty", "own") for change in changes]
    for old, change in faults.each(cases, short=len(cases)):
        if old:
            target.mkdir()
        if old == "own":
            (target / "own").write_bytes(b"older")
        after = []

        def happen(change=change, after=after):
            changes[change]()
            after.append(without_drafts(folder))

        def call(_, *, force):
            with files.written_folder(target, force=force, owns=owns) as draft:
                (draft / "own").write_bytes(b"new")

        with meanwhile(happen):
            problem = refused(call, target, force=old == "own")
        replaced = (old, change) == ("own", "one of ours")  # as --force says
        if replaced != (problem == "wrote") or (not replaced and tree(folder) != after[0]):
            faults.lose(f"{change} over {old or 'nothing'}: {problem or tree(folder).keys()}")
        for each in folder.iterdir():
            shutil.rmtree(each) if each.is_dir() and not each.is_symlink() else each.unlink()


def test_of_several_files_none_is_moved_if_one_may_not_be(faults, folder):
    """Files that belong together are looked at again before the first of them is moved."""
    for name, kind in faults.each([(n, k) for n in ("a.c", "b.h") for k in KINDS], short=10):
        after = []

        def change(name=name, kind=kind, after=after):
            come(kind, folder / name)
            after.append(without_drafts(folder))

        with meanwhile(change):
            problem = refused(export_to, folder, force=False)
        if problem or tree(folder) != after[0]:
            faults.lose(f"{name}, a {kind}: {problem or tree(folder).keys()}")
        come("file", folder / name)
        (folder / name).unlink()


OTHERS_LIKE_OURS = {
    "tasks.json": b'{\n  "version": "2.0.0",\n  "tasks": [\n    {"command": "cnnum run x"}\n  ]\n}',
    "launch.json": b'{"command": "cnnum view", "args": []}',
    "one_space.json": b'{\n "command": "cnnum view",\n "args": []\n}\n',
    "quoted.html": b"<!doctype html><html lang='en'><head><meta charset='utf-8'><title>How to mark"
    b' a page</title><body><pre><meta name="generator" content="cnnum"></pre>',
    "notes.html": b'<meta name="generator" content="cnnum">',
    "other.png": b"\x89PNG\r\n\x1a\n" + bytes(25) + b"\0\0\0\x12tEXtSoftware\0cnnumerator",
    "notes.txt": b"Software\0cnnum",
}
"""Files of users with a mark of ours in them, or a part of one."""


def test_a_mark_in_a_users_own_file_makes_it_no_report(faults, folder):
    """A user's page, picture or JSON with words of our mark in it is not replaced unasked."""
    for name in faults.each(list(OTHERS_LIKE_OURS), short=len(OTHERS_LIKE_OURS)):
        target = folder / name
        target.write_bytes(OTHERS_LIKE_OURS[name])
        write = partial(files.write_whole, content=b"ours")
        if problem := refused(write, target, force=False, why="already exists"):
            faults.lose(f"{name}: {problem}")


def test_every_report_is_written_again_unasked(folder):
    """The marks are those of the reports as they are."""
    reports = {
        name: WRITERS[name]
        for name in ("trace", "probe --picture", *(f"transient {kind}" for kind in (".html",)))
    }
    for suffix, call in reports.values():
        for _ in range(2):
            call(folder / f"out{suffix}", force=False)
        (folder / f"out{suffix}").unlink()
    pages = {
        "gallery": lambda: gallery.gallery_page([]),
        "document": lambda: html.document("t", "", "", "", "{}"),
        "reproduce": lambda: reproduce_page.page(()),
        "stability": lambda: stability_page.page(()),
        "data": lambda: data_text("cnnum bench latency --note 'a \"b\"'", [], "d", []),
    }
    for name, text in pages.items():
        (folder / name).write_text(text())
        assert files.made_here(folder / name), name


def test_without_hard_links_a_file_is_claimed_first(tmp_path, monkeypatch):
    """Where a name cannot be linked: whole or not there, and never over another."""

    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "hardlink_to", refuse)
    target = tmp_path / "out"
    with umask(0o027):
        files.write_whole(target, LONG)
    assert (target.read_text(), stat.S_IMODE(target.stat().st_mode)) == (LONG, 0o640)
    with pytest.raises(ReportError, match="already exists"):
        files.write_whole(target, b"other")
    new = tmp_path / "new"
    with (
        pytest.raises(ReportError, match="already exists"),
        meanwhile(lambda: new.write_bytes(PRECIOUS)),
    ):
        files.write_whole(new, b"ours")
    assert new.read_bytes() == PRECIOUS
    monkeypatch.setattr(Path, "replace", mock.Mock(side_effect=OSError(5, "Input/output error")))
    with pytest.raises(ReportError, match="Input/output error"):
        files.write_whole(tmp_path / "none", b"ours")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "out"]


NAMES = ("{0}/x", "../../x", "..", ".hidden", "a/b", "/", "a:b", "x" * 80, "δ" * 80, "A b")


@pytest.mark.promise
@pytest.mark.parametrize("name", NAMES)
def test_a_templates_name_leads_to_no_other_folder(name, folder):
    """Whatever a template in a file of others is called, it is written where the user says."""
    outside, inside = folder / "outside", folder / "a" / "b"
    outside.mkdir()
    inside.mkdir(parents=True)
    others = [outside / "x.toml", folder / "x.toml"]
    for each in others:
        each.write_bytes(PRECIOUS)
    name = name.format(outside)
    given, spec = folder / "given.toml", folder / "spec.toml"
    cnnum.save_template(dataclasses.replace(cnnum.get_template("EDGE"), name=name), given)
    spec.write_text(f'name = "{name}"\n[design]\nrule = "c > 0"\ndraws = 1\n')
    for words in (
        ("import", given, "--to", inside / "import", "--force"),
        ("design", spec, "--output", inside / "design", "--force"),
    ):
        before = set(tree(folder))
        done = CliRunner().invoke(main, ["templates", *map(str, words)])
        assert done.exit_code == 0, done.output
        made = Path("a", "b", words[0])
        (file,) = set(tree(folder)) - before - {made}
        assert file.parent == made
        assert not file.name.startswith(".")
        assert cnnum.load_template(folder / file).name == name
    assert {each.read_bytes() for each in others} == {PRECIOUS}


OUTPUTS = {
    "demo --out": ["demo"],
    "run --save": ["run", "demo"],
    "run --film": ["run", "demo"],
    "run --trace": ["run", "demo"],
    "replay --save": ["replay", "none.mcap"],
    "replay --film": ["replay", "none.mcap"],
    "templates show --transient": ["templates", "show", "EDGE"],
    "templates gallery --out": ["templates", "gallery"],
    "sweep --page": ["sweep", "e.toml"],
    "stability --out": ["stability"],
    "reproduce --out": ["reproduce", "eq-5.1"],
    "calibrate --out": ["calibrate", "none.csv", "--youngs-modulus", "1e6"],
    "score --out": ["score"],
    "probe --picture": ["probe", "simulated"],
    "templates compare --picture": ["templates", "compare", "EDGE", "CORNER"],
    "explain --out": ["explain", "none.mcap", "--at", "1"],
    "tune --out": ["tune", "none.mcap"],
    "tune --chart": ["tune", "none.mcap", "--out", "tuned.toml"],
}
"""Options that name a file to write, and a command that takes them."""

OTHERS = {
    *(
        "run --rerun",
        "replay --rerun",
        "run --foxglove",
        "replay --foxglove",
        "export --out",
        "sweep --output",
        "templates import --to",
    ),
    *("templates design --output", "record FILE", "recover OUT", "lerobot FOLDER"),
    *("templates export FILE", "process --out", "process --fields", "view --record"),
    *(f"bench {name} --out" for name in main.get_command(None, "bench").commands),
}
"""Those whose target is known later, or is a folder: tests above and of each command have them."""

INPUTS = {
    *("templates show --input", "sweep EXPERIMENT", "calibrate SCAN", "recover FILE"),
    *("lerobot FILE", "replay FILE", "simulate --descriptor", "simulate --link", "layout FILE"),
    *("templates find --input", "templates find --wanted", "templates find --state"),
    *("check RECORDING", "export --like", "explain FILE", "tune FILE", "tune --labels"),
    "lerobot --table",
}
"""Paths that are read; the link of a simulated port is no file."""


def path_options(command, words=()):
    if isinstance(command, click.Group):
        for name in command.list_commands(click.Context(command)):
            yield from path_options(command.get_command(None, name), (*words, name))
        return
    for one in command.params:
        name = one.opts[0] if isinstance(one, click.Option) else one.name.upper()
        named = name in ("--rerun", "--foxglove", "FILE") or (name == "--to" and "import" in words)
        if isinstance(one.type, click.Path) or named:
            yield f"{' '.join(words)} {name}"


def test_every_option_that_names_a_file_is_known():
    found = {name.replace("FILES", "FILE") for name in path_options(main)}
    assert found == {*OUTPUTS, *OTHERS, *INPUTS}


def test_commands_refuse_before_the_work(faults, folder):
    """A command whose output cannot be written says so at once, exits with 2, changes nothing."""
    cases = [(name, kind) for name in OUTPUTS for kind in KINDS]
    for name, kind in faults.each(cases, short=len(cases)):
        option = name.split()[-1]
        drawn = option in ("--picture", "--chart") or name == "explain --out"
        suffix = ".png" if drawn else {"--save": ".npz", "--film": ".gif"}.get(option, ".html")
        target = folder / f"out{suffix}"
        why = in_the_way(kind, target)
        before = tree(folder)
        done = CliRunner().invoke(main, [*OUTPUTS[name], option, str(target)])
        named = why in done.stderr or "is a directory" in done.stderr
        if done.exit_code != 2 or not named or tree(folder) != before:
            faults.lose(f"{name} over a {kind}: {done.exit_code}, {done.stderr}")
        shutil.rmtree(target) if target.is_dir() else target.unlink()
