"""Damaged HDF5 files by the thousand, each read in a fork: ``hdf5_forks.py FOLDER FIRST COUNT``.

A new process for each file takes a third of a second, most of it to load HDF5. So this process
loads it once and forks; all else is as the package does it. It prints a line of JSON.
"""

import json
import os
import random
import signal
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

from cnnum.drivers.own_data import hdf5_child, hdf5_file
from cnnum.errors import RecordingError

NAMES = ["values", "trial/time"]
PATIENCE = 20.0
"""s for a file that a healthy process reads in some milliseconds."""


def samples(folder):
    """Files of every layout of storage, small ones, as bytes."""
    import h5py

    found, values = [], np.arange(20 * 2 * 2 * 3.0).reshape(20, 2, 2, 3)
    ways = [
        {},
        {"chunks": (4, 2, 2, 3)},
        {"chunks": (4, 2, 2, 3), "compression": "gzip", "shuffle": True},
        {"chunks": (7, 2, 2, 3), "compression": "lzf", "fletcher32": True},
        {"chunks": (4, 2, 2, 3), "maxshape": (None, 2, 2, 3), "compression": "gzip"},
    ]
    for number, options in enumerate(ways):
        for version in ("earliest", "latest"):
            path = folder / f"sample{number}.h5"
            with h5py.File(path, "w", libver=version) as file:
                file.create_dataset("values", data=values, **options)
                group = file.create_group("trial", track_order=version == "latest")
                group.create_dataset("time", data=np.arange(20) / 50.0)
                group.attrs["axes"] = ["x", "y", "z"]
                file.create_dataset("many", data=np.zeros((3, 3), "i2"))
            found.append(path.read_bytes())
            path.unlink()
    return found


def damaged(data, rng):
    """The bytes with flips, cuts, stretches of others, or plausible numbers put in."""
    held = bytearray(data)
    for _ in range(rng.choice([1, 1, 1, 2, 5, 20])):
        at, kind = rng.randrange(len(held)), rng.randrange(6)
        if kind == 0:
            held[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            held[at] = rng.choice([0, 1, 2, 0x7F, 0x80, 0xFF, rng.randrange(256)])
        elif kind == 2:
            size = rng.choice([1, 2, 4, 8])
            number = rng.choice([0, 1, 2**31, 2**40, 2**63, len(held), at, rng.getrandbits(64)])
            held[at : at + size] = (number % 2 ** (8 * size)).to_bytes(size, "little")
        elif kind == 3:
            size, source = rng.randrange(1, 64), rng.randrange(len(held))
            held[at : at + size] = held[source : source + size]
        elif kind == 4:
            held[at : at + rng.randrange(1, 64)] = rng.randbytes(rng.randrange(64))
        else:
            del held[at : at + rng.choice([1, 8, 64, len(held)])]
        if not held:
            return b""
    return bytes(held)


def forked(file, request, seconds):
    """What `hdf5_file.child_answer` does, by a fork in place of a new process."""
    read, write = os.pipe()
    pid = os.fork()
    if not pid:
        try:
            os.close(read)
            with os.fdopen(write, "wb") as target:
                hdf5_child.run(dict(request), file, target)
            os._exit(0)
        except BaseException:
            os._exit(99)
    os.close(write)
    signal.setitimer(signal.ITIMER_REAL, min(seconds, PATIENCE))
    got = None
    try:
        with os.fdopen(read, "rb", buffering=0) as source:
            got = hdf5_file.received(LineReader(source), int(request["most"]))
    except TimeoutError:
        COUNTS["late"] += 1
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        done, status = os.waitpid(pid, os.WNOHANG if got is None else 0)
        if not done:
            os.kill(pid, signal.SIGKILL)
            _, status = os.waitpid(pid, 0)
        COUNTS["raw in the child"] += os.WIFEXITED(status) and os.WEXITSTATUS(status) == 99
    return got or ({"error": "it is damaged, and ended the HDF5 library that read it"}, [])


class LineReader:
    """A pipe as `subprocess` gives it: buffered, with `readline` and `readinto`."""

    def __init__(self, raw):
        self._file = os.fdopen(os.dup(raw.fileno()), "rb")
        self.readline, self.readinto = self._file.readline, self._file.readinto


COUNTS: Counter[str] = Counter()


def main(folder, first, count):
    folder.mkdir(exist_ok=True)
    sources, path, raw = samples(folder), folder / "damaged.h5", []
    import h5py  # noqa: F401

    signal.signal(signal.SIGALRM, late)
    hdf5_file.child_answer = forked
    began = time.monotonic()
    for seed in range(first, first + count):
        rng = random.Random(seed)
        path.write_bytes(damaged(rng.choice(sources), rng))
        COUNTS["tried"] += 1
        try:
            names, held = hdf5_file.read_hdf5(path, NAMES)
            assert all(isinstance(name, str) for name in names)
            COUNTS["read" if held else "not there"] += 1
        except RecordingError as error:
            said = str(error)
            ended = "ended the HDF5 library" in said
            COUNTS["ended" if ended else "refused"] += 1
            if "\n" in said or len(said) > 600 or not said.isprintable():
                raw.append((seed, said[:200]))
        except Exception as error:
            raw.append((seed, repr(error)[:200]))
    took = time.monotonic() - began
    print(json.dumps({**COUNTS, "raw": len(raw), "first": raw[:5], "seconds": round(took, 1)}))


def late(*_):
    raise TimeoutError


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
