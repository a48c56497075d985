"""Damaged HDF5 files by the thousand, read in forks: ``hdf5_forks.py FOLDER FIRST COUNT``.

A new process for each file takes a third of a second, most of it to load HDF5. So this process
loads it once and forks, and a fork reads `BATCH` files unless it dies; all else is as the package
does it. It prints a line of JSON.
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

from cnnum.errors import RecordingError
from cnnum.recordings import hdf5_child, hdf5_file

NAMES = ["values", "trial/time"]
BATCH, RAW = 32, 99
"""Files of a fork, and its exit code after an error that is no answer."""

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


class Forks:
    """Reads a batch of files, one after the other: `answer` is `hdf5_file.child_answer` by a fork.

    The files are opened before, since a child may open none. A child that ends or is late is
    replaced for the next file.
    """

    def __init__(self, places):
        self._files = [place.open("rb") for place in places]
        self._next = 0
        self._pid = 0

    def _start(self):
        asked, self._asks = os.pipe()
        answers, answered = os.pipe()
        self._pid = os.fork()
        if not self._pid:
            try:
                os.close(self._asks)
                with os.fdopen(asked) as lines, os.fdopen(answered, "wb") as target:
                    for line in lines:
                        request = json.loads(line)
                        hdf5_child.run(request, self._files[request["number"]], target)
                        hdf5_child.limit = lambda *_: None  # it is limited, and for good
                os._exit(0)
            except BaseException:
                os._exit(RAW)
        os.close(asked)
        os.close(answered)
        self._answers = os.fdopen(answers, "rb")

    def answer(self, _, request, seconds):
        if not self._pid:
            self._start()
        line, got = json.dumps({**request, "number": self._next}) + "\n", None
        self._next += 1
        signal.setitimer(signal.ITIMER_REAL, min(seconds, PATIENCE))
        try:
            os.write(self._asks, line.encode())
            got = hdf5_file.received(self._answers, int(request["most"]))
        except TimeoutError:
            COUNTS["late"] += 1
            os.kill(self._pid, signal.SIGKILL)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            if got is None:
                self.end()
        return got or ({"error": "it is damaged, and ended the HDF5 library that read it"}, [])

    def end(self):
        """End the child, after what it has begun."""
        if self._pid:
            os.close(self._asks)
            self._answers.close()
            _, status = os.waitpid(self._pid, 0)
            COUNTS["raw in the child"] += os.WIFEXITED(status) and os.WEXITSTATUS(status) == RAW
            self._pid = 0

    def close(self):
        self.end()
        for file in self._files:
            file.close()


COUNTS: Counter[str] = Counter()


def main(folder, first, count):
    folder.mkdir(exist_ok=True)
    sources, raw = samples(folder), []
    import h5py  # noqa: F401

    signal.signal(signal.SIGALRM, late)
    began = time.monotonic()
    for begin in range(first, first + count, BATCH):
        seeds = range(begin, min(begin + BATCH, first + count))
        places = {seed: folder / f"{seed}.h5" for seed in seeds}
        for seed, path in places.items():
            rng = random.Random(seed)
            path.write_bytes(damaged(rng.choice(sources), rng))
        forks = Forks(places.values())
        hdf5_file.child_answer = forks.answer
        for seed, path in places.items():
            if why := read(path):
                raw.append((seed, why[:200]))
        forks.close()
        for path in places.values():
            path.unlink()
    took = time.monotonic() - began
    print(json.dumps({**COUNTS, "raw": len(raw), "first": raw[:5], "seconds": round(took, 1)}))


def read(path):
    """Read a file and count how it ended; return what is wrong with that."""
    COUNTS["tried"] += 1
    try:
        names, held = hdf5_file.read_hdf5(path, NAMES)
        assert all(isinstance(name, str) for name in names)
        COUNTS["read" if held else "not there"] += 1
    except RecordingError as error:
        said = str(error)
        COUNTS["ended" if "ended the HDF5 library" in said else "refused"] += 1
        return said if "\n" in said or len(said) > 600 or not said.isprintable() else ""
    except Exception as error:
        return repr(error)
    return ""


def late(*_):
    raise TimeoutError


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
