"""Cache folders that are full, read-only, or not ours: every run ends, with the right numbers."""

import itertools
import os
import shutil
import subprocess

import pytest
from cached_runs import ENGINES, LIMITED, SUM, child, environment, lost, on_two_cores


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
    on_two_cores(faults, list(itertools.product(MOUNTS, ENGINES)), trial, short=5)
