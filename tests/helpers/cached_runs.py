"""Runs in processes of their own, whose caches lie in a folder that a test may spoil."""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np

import cnnum

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


def on_two_cores(faults, cases, trial, short):
    """Run trials side by side; note the losses of each."""
    with ThreadPoolExecutor(2) as pool:
        chosen = [(case, pool.submit(trial, case)) for case in faults.each(cases, short=short)]
        for case, done in chosen:
            why = done.result()
            if why:
                faults.lose(f"{case}: {why}")
