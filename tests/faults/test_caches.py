"""Caches that are damaged, full, read-only, or not ours: every run ends, with the right numbers.

Each trial is a process of its own, with a copy of a cache that was good before.
"""

import hashlib
import itertools
import json
import os
import random
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import cnnum
from cnnum.engines.cache import Shelf

ROOT = Path(__file__).parents[2]
PICTURE = np.random.default_rng(3).uniform(-1, 1, (5, 4))

START = """
import json, sys, numpy, cnnum
name = sys.argv[1] if sys.argv[1] != "any" else None
picture, engine = numpy.array(json.loads(sys.argv[2])), cnnum.Engine(name)
"""

TRANSIENT = (
    START
    + """
template = cnnum.get_template("DIFFUS")
ran = engine.run(template, input=picture, method="euler", dt=0.1, duration=1.0)
print(json.dumps([engine.name, ran.state.tolist()]))
"""
)

# compiled within a second, while a transient of the engine "numba" takes half a minute
SUM = (
    START
    + """
@cnnum.program
def total(frame):
    return {"sum": frame.normal.sum()}

frame = numpy.zeros((5, 4, 3))
frame[..., 2] = picture
print(json.dumps([engine.name, float(engine.compile(total, (5, 4))(frame)["sum"])]))
"""
)

LIMITED = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, ({0}, {0}))
"""

ENGINES = ("any", "numba")
"""OpenCL where it is, else Numba; and Numba."""

WITHOUT = ("CNNUM_CACHE", "POCL_CACHE_DIR", "NUMBA_CACHE_DIR", "PYOPENCL_NO_CACHE", "TMPDIR")


@cache
def right(code):
    if code == SUM:
        return PICTURE.sum()
    reference = cnnum.Engine("reference")
    template = cnnum.get_template("DIFFUS")
    return reference.run(template, input=PICTURE, method="euler", dt=0.1, duration=1.0).state


def environment(folder, **given):
    """The environment of a child: its caches and temporary files lie in a folder."""
    kept = {name: value for name, value in os.environ.items() if name not in WITHOUT}
    temporary = folder / "temporary"
    temporary.mkdir(exist_ok=True)
    kept |= {"XDG_CACHE_HOME": str(folder), "TMPDIR": str(temporary), "PYTHONPATH": str(ROOT)}
    kept |= given
    return {name: value for name, value in kept.items() if value is not None}


def child(engine, code, env, before="", prefix=()):
    command = [*prefix, sys.executable, "-c", before + code, engine]
    command.append(json.dumps(PICTURE.tolist()))
    return subprocess.run(
        command, env=env, capture_output=True, text=True, check=False, timeout=300, cwd="/"
    )


def lost(done, code, engine):
    """Return why a child failed; nothing if it did not."""
    if done.returncode != 0:
        return f"exit code {done.returncode}: {done.stderr[-300:]}"
    name, numbers = json.loads(done.stdout.splitlines()[-1])
    if engine not in (name, "any"):
        return f"ran on {name}"
    # float32: ten steps, and twenty summands, of numbers within ±1
    if not np.allclose(numbers, right(code), rtol=0, atol=1e-5):
        return f"wrong numbers: {numbers}"
    return ""


@pytest.fixture(scope="module")
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


def truncated(place, rng):
    os.truncate(place, rng.randrange(place.stat().st_size))


def flipped(place, rng):
    content = bytearray(place.read_bytes())
    for _ in range(rng.choice([1, 1, 8, 64])):
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    place.write_bytes(content)


def emptied(place, rng):
    os.truncate(place, 0)


def garbage(place, rng):
    place.write_bytes(rng.randbytes(place.stat().st_size))


def a_folder(place, rng):
    place.unlink()
    (place / "inner").mkdir(parents=True)


def a_pipe(place, rng):
    place.unlink()
    os.mkfifo(place)


def a_link_to_nowhere(place, rng):
    place.unlink()
    place.symlink_to("/nowhere/at/all")


DAMAGES = (truncated, flipped, flipped, emptied, garbage, a_folder, a_pipe, a_link_to_nowhere)
OURS = {
    "cnnum/kernels/*": ("opencl", TRANSIENT),
    "cnnum/verdicts/*": ("opencl", TRANSIENT),
    "cnnum/numba/*": ("numba", SUM),
}
THEIRS = {
    "pocl/kcache/*/*/program.bc": ("opencl", TRANSIENT),
    "pocl/kcache/*/*/*/*/*.so": ("opencl", TRANSIENT),
    "pytools/*.sqlite": ("opencl", TRANSIENT),
}


def on_two_cores(faults, cases, trial, short):
    """Run trials side by side; note what each of them loses."""
    with ThreadPoolExecutor(2) as pool:
        chosen = [(case, pool.submit(trial, case)) for case in faults.each(cases, short=short)]
        for case, done in chosen:
            why = done.result()
            if why:
                faults.lose(f"{case}: {why}")


@pytest.fixture
def copied(good, tmp_path):
    """Copies of the good caches, one a trial."""
    numbers = itertools.count()

    def copy():
        folder = tmp_path / str(next(numbers))
        shutil.copytree(good, folder)
        return folder

    return copy


def damages_of(good, patterns, rounds):
    """Each damage to each cache that is here: those of OpenCL are only where it is."""
    here = [pattern for pattern in patterns if list(good.glob(pattern))]
    rows = itertools.product(range(rounds), enumerate(DAMAGES), here)
    return [(here, damage, 100 * turn + number) for turn, (number, damage), here in rows]


def whole(place):
    checksum, _, content = (place.read_bytes() if place.is_file() else b"").partition(b"\n")
    return checksum == hashlib.sha256(content).hexdigest().encode()


def test_damaged_entries_are_made_anew(faults, good, copied):
    """A damaged entry of cnnum's cache is seen, dropped with one sentence, and made anew."""

    def trial(case):
        pattern, damage, seed = case
        folder, (engine, code) = copied(), OURS[pattern]
        places = list(folder.glob(pattern))
        for place in places:
            damage(place, random.Random(seed))
        done = child(engine, code, environment(folder))
        if why := lost(done, code, engine):
            return why
        if done.stderr.count("is dropped and made anew") != 1 or done.stderr.count("\n") != 1:
            return f"said: {done.stderr}"
        return "" if any(map(whole, places)) else "not made anew"

    on_two_cores(faults, damages_of(good, OURS, rounds=2), trial, short=6)


def test_caches_of_others_are_not_read(faults, good, copied):
    """Damage to the caches that PoCL and PyOpenCL keep by themselves has no effect."""
    cases = damages_of(good, THEIRS, rounds=2)
    if not cases:
        pytest.skip("this test is about OpenCL")

    def trial(case):
        pattern, damage, seed = case
        folder, (engine, code) = copied(), THEIRS[pattern]
        for place in list(folder.glob(pattern)):
            damage(place, random.Random(seed))
        shutil.rmtree(folder / "cnnum" / "kernels")  # what is ours must not hide it
        done = child(engine, code, environment(folder))
        return lost(done, code, engine) or done.stderr

    on_two_cores(faults, cases, trial, short=3)


def test_no_change_of_a_byte_is_overlooked(faults, tmp_path, monkeypatch):
    """An entry of which any one byte is changed, or that is cut anywhere, is not used."""
    monkeypatch.setenv("CNNUM_CACHE", str(tmp_path))
    shelf = Shelf("trial")
    shelf.put("entry", b"what is kept")
    place = tmp_path / "trial" / "entry"
    whole = place.read_bytes()
    assert shelf.get("entry") == b"what is kept"
    changed = [
        whole[:at] + bytes([whole[at] ^ (1 << bit)]) + whole[at + 1 :]
        for at in range(len(whole))
        for bit in range(8)
    ]
    for content in faults.each([*changed, *(whole[:at] for at in range(len(whole)))], short=60):
        place.write_bytes(content)
        if shelf.get("entry") is not None or place.exists():
            faults.lose(repr(content))


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

    on_two_cores(faults, list(itertools.product(PLACES, ENGINES)), trial, short=6)


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


def test_processes_that_build_at_once(faults, good, tmp_path):
    """Processes that build at once share an empty cache, and leave a good one."""
    for number in faults.trials(short=1, full=5):
        folder = tmp_path / str(number)
        folder.mkdir()
        env = environment(folder)
        with ThreadPoolExecutor(4) as pool:
            started = [pool.submit(child, engine, SUM, env) for engine in (*ENGINES, *ENGINES)]
            for done, engine in zip(started, (*ENGINES, *ENGINES), strict=True):
                if why := lost(done.result(), SUM, engine):
                    faults.lose(why)
        for engine in ENGINES:
            done = child(engine, SUM, env)
            if why := lost(done, SUM, engine) or done.stderr:
                faults.lose(why)
