"""Programs in whole numbers on short streams: a rest, a press, a pull across, and noise."""

import inspect
import os
import shutil
import subprocess

import numpy as np
import pytest

import cnnum
from cnnum.embedded.formats import precision_named
from cnnum.embedded.making import make
from cnnum.frame import FORCE_AXES
from cnnum.graph.schedule import schedule
from cnnum.programs.library import program_names

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-ffp-contract=off")
FULL = "CNNUM_FRAMES" in os.environ
# many frames take longer than the compiler does
SANITIZERS = (
    "-fsanitize=undefined,address", "-fno-sanitize-recover=all", "-O1" if FULL else "-O0",
)  # fmt: skip
SPIKING = ("_spikes", "_spike_time", "_spike_gap", "_first")
SHORT = {"rate": 40.0, "rest": 0.2}


def cases(quick, precisions):
    """Programs and precisions; those that are not quick wait for `make embedded`."""
    wait = pytest.mark.skip("make embedded")
    return [
        pytest.param(name, one, marks=() if FULL or (name in quick and one in precisions) else wait)
        for name in (*program_names("tactile"), *program_names("tactile.contact_mechanics"))
        for one in ("q15", "q7", "q31")
    ]


def streams(shape, frames=60, batch=3, seed=0):
    """(frames, batch, rows, cols, 3) strains: noise, and from frame 12 a bump that is pulled."""
    random = np.random.default_rng(seed)
    rows, cols = np.indices(shape)
    time = np.arange(frames)[:, None, None, None]
    push = np.clip((time - 12) / 10, 0.0, 1.0)
    pull = np.clip((time - 26) / 12, 0.0, 1.0)
    start = random.uniform(1.5, min(shape) - 2.5, (2, 1, batch, 1, 1))
    moved = 0.15 * np.clip(time - 36, 0, 10)
    far = (rows - start[0]) ** 2 + (cols - start[1] - moved) ** 2
    bump = np.exp(-far / 4.0)
    normal, shear = -0.05 * push, -0.03 * push * pull
    sense = np.array([0.0, 0.03, -0.03])[:batch][None, :, None, None]
    turn = sense * push * pull
    maps = [
        (sense == 0.0) * shear * bump + turn * (rows - start[0]) * bump,
        -turn * (cols - start[1]) * bump,
        normal * bump,
    ]
    clean = np.stack(np.broadcast_arrays(*maps), axis=-1)
    return clean + 5e-5 * random.standard_normal(clean.shape)


def scheduled(name, shape=(8, 8), needs=None):
    program = cnnum.get_program(name)
    takes = inspect.signature(program.function).parameters
    program = program.bind(
        **{key: value for key, value in SHORT.items() if key in ("rate", *takes)}
    )
    graph = program.trace(shape, FORCE_AXES)
    if needs is None and name == "receptors":  # spikes take a logarithm, which is none of these
        needs = [output for output in graph.outputs if not output.endswith(SPIKING)]
    return schedule(graph, FORCE_AXES, needs)


def made(name, precision, shape=(8, 8), method="auto", needs=None):
    frames = streams(shape)
    return make(name, scheduled(name, shape, needs), precision_named(precision), frames, method)


@cnnum.program
def _patient(frame):
    edge = cnnum.get_template("EDGE")
    return {"edge": cnnum.apply(edge, input=frame.normal, duration=1e6)}


def too_long(precision="q15"):
    """Make a program whose cells saturate for a million time constants: it is refused."""
    planned = schedule(_patient.trace((8, 8), FORCE_AXES), FORCE_AXES, None)
    return make("patient", planned, precision_named(precision), streams((8, 8)))


@pytest.fixture(scope="session")
def compiler():
    found = shutil.which("cc") or shutil.which("gcc")
    if found is None:
        pytest.skip("needs a C compiler")
    return found


def compiled(compiler, folder, name, main, *flags):
    target = folder / main.removesuffix(".c")
    libraries = ["-lm"] if "of libm" in (folder / f"{name}.c").read_text() else []
    command = [compiler, *STRICT, *flags, "-o", target, main, f"{name}.c", *libraries]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return target
