"""How long a plan takes to build: from nothing, and from what is kept."""

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass

from cnnum.library import get_template
from cnnum.programs import Program, program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply

NAMES = (
    "EDGE", "CORNER", "DIFFUS", "HOLE", "RECALL", "CCD_HOR",
    "SHADOW", "EDGEGRAY", "AVERAGE", "JUNCTION", "EROSION", "DILATION",
)  # fmt: skip
"""A dozen templates of different kinds: local, propagating, diffusing."""

_CHILD = """
import sys, time
from cnnum.bench.compile_time import dozen
from cnnum.engine import Engine
import numpy as np
engine = Engine(device=sys.argv[1])
begin = time.perf_counter()
plan = engine.compile(dozen(), (8, 8))
plan(np.zeros((8, 8, 3)))
print(time.perf_counter() - begin)
"""


def dozen() -> Program:
    """Return a program of a dozen templates on the frame's first channel."""

    @program
    def every_template(frame: FrameFields) -> dict[str, Field]:
        first = frame.channel(frame.channels[0])
        return {name: apply(get_template(name), input=first) for name in NAMES}

    return every_template


@dataclass(frozen=True, slots=True)
class CompileTime:
    """A row of `cnnum bench compile`.

    Attributes
    ----------
    case, device : str
    templates : int
        In the plan.
    cold_s, warm_s : float
        To the first result: with empty caches, and in a new process with full ones.
    """

    case: str
    device: str
    templates: int
    cold_s: float
    warm_s: float


def measure_compile(device: str, *, repeats: int = 3) -> CompileTime:
    """Return the row of a plan of a dozen 8×8 templates on a device.

    Each start is a process of its own; the caches of PoCL and of cnnum lie in a folder that is
    empty at first.
    """
    cold: list[float] = []
    warm: list[float] = []
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as cache:
            cold.append(_start(device, cache))
            warm.append(min(_start(device, cache), _start(device, cache)))
    return CompileTime("a dozen 8×8 templates", device, len(NAMES), min(cold), min(warm))


def _start(device: str, cache: str) -> float:
    variables = {"POCL_CACHE_DIR": cache, "XDG_CACHE_HOME": cache, "CNNUM_CACHE": cache}
    done = subprocess.run(
        [sys.executable, "-c", _CHILD, device],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, **variables, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    return float(done.stdout.split()[-1])
