"""Caches that are damaged or shared: every run ends, with the right numbers.

Each trial is a process of its own, with a copy of a cache that was good before.
"""

import hashlib
import itertools
import os
import random
import shutil
from concurrent.futures import ThreadPoolExecutor

import pytest
from cached_runs import ENGINES, SUM, TRANSIENT, child, environment, lost, on_two_cores

from cnnum.engines.cache import Shelf


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
        shutil.rmtree(folder / "cnnum" / "kernels")  # our own cache must not hide it
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
