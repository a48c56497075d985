"""Cache folders that are full, read-only, or not ours: every run ends, with the right numbers."""

import grp
import hashlib
import itertools
import os
import pickle
import pwd
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from cached_runs import ENGINES, LIMITED, SUM, child, environment, lost, on_two_cores

from cnnum.engines import cache
from cnnum.engines.cache import Shelf

ROOT = Path(__file__).parents[2]


def a_file(place):
    shutil.rmtree(place)
    place.write_text("a file in the place of a folder")


def a_link(place):
    elsewhere = place.with_name("elsewhere")
    place.rename(elsewhere)
    place.symlink_to(elsewhere)


def of_another(place):
    os.chown(place, 12345, 12345)


def for_all(place):
    place.chmod(0o777)


def below_all(place):
    place.parent.chmod(0o777)


UNTRUSTED = (a_file, a_link, of_another, for_all, below_all)


def contents(folder):
    return {
        (place.relative_to(folder), place.read_bytes())
        for place in folder.rglob("*")
        if place.is_file() and "temporary" not in place.parts
    }


def test_folders_that_are_not_ours_are_left_alone(faults, copied):
    """A cache folder that is another user's, a link, a file, or open to others is not touched."""

    def trial(case):
        spoil, engine = case
        folder = copied()
        spoil(folder / "cnnum")
        before = contents(folder)
        done = child(engine, SUM, environment(folder))
        if why := lost(done, SUM, engine):
            return why
        if contents(folder) != before:
            return "changed"
        if list(folder.glob("temporary/*")):
            return "left behind its temporary folder"
        return "" if done.stderr.count("Nothing is kept for the next start") == 1 else done.stderr

    root = os.geteuid() == 0
    chosen = [spoil for spoil in UNTRUSTED if root or spoil is not of_another]
    on_two_cores(faults, list(itertools.product(chosen, ENGINES)), trial, short=3)


def planted(folder):
    """A cache whose entry of Numba is a pickle that leaves a mark when it is loaded."""
    shelf = folder / "own" / "cnnum" / "numba"
    shelf.mkdir(parents=True, mode=0o700)
    shelf.parent.chmod(0o700)
    mark = folder / "ran"
    content = pickle.dumps(Mark(str(mark)))
    (shelf / "entry").write_bytes(hashlib.sha256(content).hexdigest().encode() + b"\n" + content)
    (shelf / "entry").chmod(0o600)
    return shelf / "entry", mark


class Mark:
    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (Path.touch, (Path(self.path),))


def entry_of_another(entry):
    os.chown(entry, 12345, 12345)


def shelf_of_another(entry):
    os.chown(entry.parent, 12345, 12345)


def above_of_another(entry):
    os.chown(entry.parents[2], 12345, 12345)


def entry_is_a_link(entry):
    entry.rename(entry.with_name("real"))
    entry.symlink_to(entry.with_name("real"))


def shelf_is_a_link(entry):
    entry.parent.rename(entry.parents[1] / "real")
    entry.parent.symlink_to(entry.parents[1] / "real")


OPENINGS = {
    "entry of another": entry_of_another,
    "shelf of another": shelf_of_another,
    "folder above of another": above_of_another,
    "link in place of the entry": entry_is_a_link,
    "link in place of the shelf": shelf_is_a_link,
    **{
        f"{name} {mode:o}": (lambda entry, up=up, mode=mode: entry_at(entry, up).chmod(mode))
        for name, up, modes in (
            ("entry", 0, (0o666, 0o620)),
            ("shelf", 1, (0o777, 0o730)),
            ("cache", 2, (0o777, 0o730)),
            ("folder above", 3, (0o777,)),
        )
        for mode in modes
    },
}


def entry_at(entry, up):
    return entry if up == 0 else entry.parents[up - 1]


def test_an_entry_that_others_could_write_is_never_loaded(faults, tmp_path, monkeypatch):
    """An entry is loaded only if all folders on its way, and itself, are the user's alone."""
    root = os.geteuid() == 0
    names = [name for name in OPENINGS if root or "another" not in name]
    for name in faults.each(["untouched", *names], short=len(OPENINGS) + 1):
        folder = tmp_path / name.replace(" ", "-")
        folder.mkdir()
        entry, mark = planted(folder)
        OPENINGS.get(name, lambda _: None)(entry)
        monkeypatch.setenv("CNNUM_CACHE", str(folder / "own" / "cnnum"))
        monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
        content = Shelf("numba", "NUMBA_CACHE_DIR").get("entry")
        if content is not None:
            pickle.loads(content)
        if mark.exists() != (name == "untouched"):
            faults.lose(name)


GROUPS = {
    "private": ("me", [], True),
    "private, listed": ("me", ["me"], True),
    "private with another": ("me", ["you"], False),
    "shared": ("users", [], False),
    "without a name": (None, [], False),
}


def test_a_folder_above_that_a_shared_group_may_write_to_is_not_trusted(faults, monkeypatch):
    """A folder above the cache that a group of others may write to is as one for all."""
    monkeypatch.setattr(os, "getuid", lambda: 1000)
    monkeypatch.setattr(os, "getgid", lambda: 100)
    monkeypatch.setattr(pwd, "getpwuid", lambda _: SimpleNamespace(pw_name="me"))
    for case in faults.each(list(GROUPS), short=len(GROUPS)):
        name, members, trusted = GROUPS[case]

        def group(number, name=name, members=members):
            if name is None:
                raise KeyError(number)
            return SimpleNamespace(gr_name=name, gr_mem=members)

        monkeypatch.setattr(grp, "getgrgid", group)
        for mode, owner, gid, safe in (
            (0o775, 1000, 100, trusted),
            (0o755, 1000, 100, True),
            (0o775, 1000, 50, False),
            (0o1775, 1000, 50, True),
            (0o775, 0, 0, True),
            (0o755, 50, 0, False),
        ):
            found = SimpleNamespace(st_mode=stat.S_IFDIR | mode, st_uid=owner, st_gid=gid)
            if cache._replaceable(found) == safe:
                faults.lose(f"{case}, {mode:o}, {owner}, {gid}")


def test_entries_are_the_user_s_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("CNNUM_CACHE", str(tmp_path / "cnnum"))
    before = os.umask(0)
    try:
        Shelf("kernels").put("one", b"content")
        Shelf("kernels").put("one", b"again")
    finally:
        os.umask(before)
    entry = tmp_path / "cnnum" / "kernels" / "one"
    assert [path.stat().st_mode & 0o777 for path in (entry, *entry.parents[:2])] == [
        0o600,
        0o700,
        0o700,
    ]
    assert Shelf("kernels").get("one") == b"again"


HOMES = {"none": None, "empty": "", "relative": "rel"}
NOBODY = """
import logging, pwd
def none(*_): raise KeyError("uid not found")
pwd.getpwuid = pwd.getpwnam = none
logging.basicConfig(format="cnnum: %(message)s")
from cnnum.engines.cache import Shelf
for shelf in (Shelf("kernels"), Shelf("verdicts")):
    shelf.put("one", b"content")
    assert shelf.get("one") is None
"""


def test_a_user_without_a_home_is_told_so_once(faults, tmp_path):
    """Without an entry in passwd, and with no home, an empty or a relative one, nothing is kept."""
    for name in faults.each(list(HOMES), short=len(HOMES)):
        env = {key: value for key, value in os.environ.items() if key[:4] not in ("HOME", "XDG_")}
        env.pop("CNNUM_CACHE", None)
        env.pop("NUMBA_CACHE_DIR", None)
        home = HOMES[name]
        env |= {"PYTHONPATH": str(ROOT)} | ({} if home is None else {"HOME": home})
        words = [sys.executable, "-c", NOBODY]
        done = subprocess.run(words, env=env, cwd=tmp_path, capture_output=True, text=True)
        said = [line for line in done.stderr.splitlines() if line.startswith("cnnum:")]
        if done.returncode or len(said) != 1 or "has no home folder" not in said[0]:
            faults.lose(f"{name}: {done.returncode}, {done.stderr[-500:]}")
        if list(tmp_path.iterdir()):
            faults.lose(f"{name}: left {list(tmp_path.iterdir())}")


def test_folders_inside_the_cache_are_made_anew(faults, copied):
    """A file in the place of any folder of the cache is replaced by that folder."""

    def trial(case):
        kind, engine = case
        folder = copied()
        shutil.rmtree(folder / "cnnum" / kind, ignore_errors=True)
        (folder / "cnnum" / kind).write_text("a file in the place of a folder")
        return lost(child(engine, SUM, environment(folder)), SUM, engine)

    kinds = ("kernels", "verdicts", "numba", "work")
    on_two_cores(faults, list(itertools.product(kinds, ENGINES)), trial, short=2)


PLACES = {
    "no home": {"HOME": None, "XDG_CACHE_HOME": None},
    "a home that is not there": {"HOME": "/dev/null/home", "XDG_CACHE_HOME": None},
    "a home that is no full path": {"HOME": "home", "XDG_CACHE_HOME": None},
    "a file": {"XDG_CACHE_HOME": __file__},
    "below a file": {"XDG_CACHE_HOME": f"{__file__}/cache"},
    "nowhere": {"CNNUM_CACHE": "/dev/null/cache"},
    "no full path": {"CNNUM_CACHE": "cache"},
    "off": {"CNNUM_CACHE": "off"},
    "no temporary folder": {"CNNUM_CACHE": "off", "TMPDIR": "/dev/null"},
    "PoCL's is a file": {"POCL_CACHE_DIR": __file__},
    "Numba's is a file": {"NUMBA_CACHE_DIR": __file__},
}


def test_places_that_cannot_be_used(faults, tmp_path):
    """Without a home, or with a file in the place of the cache, a run has the right numbers."""
    numbers = itertools.count()

    def trial(case):
        place, engine = case
        folder = tmp_path / str(next(numbers))
        folder.mkdir()
        # no folder for PoCL is as no OpenCL
        wanted = "any" if place.startswith("PoCL") else engine
        done = child(wanted, SUM, environment(folder, **PLACES[place]))
        left = list(folder.glob("temporary/*"))
        return lost(done, SUM, wanted) or (f"left behind {left}" if left else "")

    on_two_cores(faults, list(itertools.product(PLACES, ENGINES)), trial, short=4)


def test_files_that_cannot_grow(faults, tmp_path):
    """Where no file, or none of some size, can be written, a run has the right numbers."""
    numbers = itertools.count()

    def trial(case):
        limit, engine = case
        folder = tmp_path / str(next(numbers))
        folder.mkdir()
        # without room for its work PoCL is not used
        done = child(engine, SUM, environment(folder), before=LIMITED.format(limit))
        return lost(done, SUM, engine)

    limits = (0, 1, 100, 4096, 20_000, 100_000, 1_000_000)
    on_two_cores(faults, list(itertools.product(limits, ("any", "numba"))), trial, short=4)


def mounted(script, engine, env):
    """Run where folders are mounted for the child alone; None where that is not allowed."""
    tried = subprocess.run(["unshare", "--mount", "true"], capture_output=True, check=False)
    if tried.returncode:
        return None
    prefix = ("unshare", "--mount", "sh", "-c", f'{script} && exec "$@"', "sh")
    return child(engine, SUM, env, prefix=prefix)


SIZES = (4, 16, 64, 128, 256, 1024, 4096, 8192)
MOUNTS = {f"{size} kB": f"mount -t tmpfs -o size={size}k none {{0}}" for size in SIZES}
MOUNTS |= {
    "no more files": "mount -t tmpfs -o nr_inodes=1 none {0}",
    "read-only": "mount --bind {0} {0} && mount -o remount,bind,ro {0}",
    "no programs": "mount -t tmpfs -o noexec none {0}",
}


@pytest.mark.in_full("test_folders_that_are_not_ours_are_left_alone")
@pytest.mark.skipif(shutil.which("unshare") is None, reason="no way to mount for a child alone")
def test_full_and_read_only_disks(faults, copied):
    """On a disk that is full, read-only, or runs no programs, a run has the right numbers."""

    def trial(case):
        mount, engine = case
        folder = copied()
        script = MOUNTS[mount].format(folder / "cnnum")
        done = mounted(script, engine, environment(folder))
        return lost(done, SUM, engine)

    if mounted("true", "numba", environment(copied())) is None:
        pytest.skip("no mounts are allowed here")
    on_two_cores(faults, list(itertools.product(MOUNTS, ENGINES)), trial, short=3)
