"""How long a plan takes to build: from nothing, and from the cache."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.lab.bench.samples import maps
from cnnum.programs import Program, program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply
from cnnum.templating.library import get_template

NAMES = (
    "EDGE", "CORNER", "DIFFUS", "HOLE", "RECALL", "CCD_HOR",
    "SHADOW", "EDGEGRAY", "AVERAGE", "JUNCTION", "EROSION", "DILATION",
)  # fmt: skip
"""A dozen templates of different kinds: local, propagating, diffusing."""

_CHILD = """
import sys, time
from cnnum.lab.bench.compile_time import SHAPE, dozen, picture
from cnnum.engine import Engine
import numpy as np
engine, frame = Engine(sys.argv[1], device=sys.argv[2] or None), picture()
begin = time.perf_counter()
plan = engine.compile(dozen(), SHAPE)
found = plan(frame)
print(time.perf_counter() - begin)
np.savez(sys.argv[3], **found)
"""

SHAPE = (8, 8)

STARTS = 3
"""Of a folder for caches: one that finds it empty, two that do not."""


def picture() -> Floats:
    """Return the frame that every start runs: greys of a fixed seed in its first channel."""
    return maps(*SHAPE, 3)


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
    error : float
        Largest difference of any start's outputs, which lie between −1 and 1, from the reference
        engine's.
    """

    case: str
    device: str
    templates: int
    cold_s: float
    warm_s: float
    error: float


def measure_compile(engine: Engine, *, repeats: int = 3) -> Iterator[CompileTime | None]:
    """Yield the row of a plan of a dozen 8×8 templates on an engine, after None for each start.

    Each start is a process of its own, `STARTS` a repeat. The caches of PoCL and of cnnum lie in a
    folder that is empty at first.
    """
    cold: list[_Start] = []
    warm: list[_Start] = []
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as cache:
            for number in range(STARTS):
                (warm if number else cold).append(_start(engine, Path(cache)))
                yield None
    true = Engine("reference").compile(dozen(), SHAPE)(picture())
    yield CompileTime(
        "a dozen 8×8 templates",
        engine.device,
        len(NAMES),
        min(start.seconds for start in cold),
        min(start.seconds for start in warm),
        largest_difference([start.outputs for start in cold + warm], true),
    )


def largest_difference(
    answers: Sequence[Mapping[str, Floats]], true: Mapping[str, Floats]
) -> float:
    """Return the largest difference of any answer's outputs from the truth."""
    return max(
        float(np.abs(answer[name] - true[name]).max()) for answer in answers for name in true
    )


@dataclass(frozen=True, slots=True)
class _Start:
    seconds: float
    outputs: dict[str, NDArray[np.float64]]


def _start(engine: Engine, cache: Path) -> _Start:
    names = ("POCL_CACHE_DIR", "XDG_CACHE_HOME", "CNNUM_CACHE")
    variables = dict.fromkeys(names, str(cache))
    answers, device = cache / "answers.npz", engine.device if engine.name == "opencl" else ""
    done = subprocess.run(
        [sys.executable, "-P", "-c", _CHILD, engine.name, device, str(answers)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, **variables, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    with np.load(answers) as kept:
        return _Start(float(done.stdout.split()[-1]), {name: kept[name] for name in NAMES})
