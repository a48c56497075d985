"""Processes that are forked from one in which an engine was used: nothing hangs."""

import itertools
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import cnnum

ROOT = Path(__file__).parents[2]

# the parent uses an engine; then each of its children does one thing, and says how it ended
PARENT = """
import json, multiprocessing, os, signal, sys, warnings
import numpy, cnnum

warnings.simplefilter("ignore", DeprecationWarning)  # of Python 3.12: a fork, and threads
first, used, side, way = json.loads(sys.argv[1])
picture = numpy.random.default_rng(side).uniform(-1, 1, (side, side))
frame = numpy.stack([numpy.zeros_like(picture), numpy.zeros_like(picture), picture], axis=-1)
template = cnnum.get_template("DIFFUS")

@cnnum.program
def total(frame):
    return {"sum": frame.normal.sum()}

def run(engine):
    ran = engine.run(template, input=picture, method="euler", dt=0.1, duration=1.0)
    return [engine.name, float(ran.state.sum())]

def push(stream):
    return [stream.plan.engine, float(stream.push(frame)["sum"])]

engine = cnnum.Engine(first)
plan = engine.compile(total, (side, side))
stream = plan.stream()
if used:
    run(engine)
    push(stream)

WORKS = {
    "old engine": lambda: run(engine),
    "old plan": lambda: push(plan.stream()),
    "old plan, a batch": lambda: [first, float(plan(frame)["sum"])],
    "old stream": lambda: push(stream),
    "old engine, new plan": lambda: push(engine.compile(total, (side, side)).stream()),
    "new engine": lambda: run(cnnum.Engine(first)),
    "any engine": lambda: run(cnnum.Engine()),
}

def child(then):
    signal.alarm(90)
    try:
        said = WORKS[then]()
    except cnnum.CnnumError as error:
        said = [type(error).__name__, str(error)]
    print(json.dumps([then, *said]), flush=True)

for then in WORKS:
    if way == "multiprocessing":
        process = multiprocessing.get_context("fork").Process(target=child, args=(then,))
        process.start()
        process.join()
        status = process.exitcode
    else:
        number = os.fork()
        if number == 0:
            child(then)
            if way == "ends at once":
                os._exit(0)
            sys.exit(0)
        status = os.waitpid(number, 0)[1]
    if status:
        print(json.dumps([then, "status", status]), flush=True)

# the parent goes on as before
print(json.dumps(["parent", *run(engine)]), flush=True)
push(stream)
"""

WAYS = ("ends at once", "ends as others", "multiprocessing")
CASES = list(itertools.product((False, True), (200, 8), WAYS))


@pytest.fixture(scope="module", autouse=True)
def compiled():
    """Compile for the children, or each would do it at its own."""
    cnnum.Engine("numba").run(cnnum.get_template("DIFFUS"), input=[[0.0]], method="euler", dt=0.1)


def played(case):
    """Return the output of a parent's children, and of the parent itself."""
    done = subprocess.run(
        [sys.executable, "-c", PARENT, json.dumps(case)],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr[-500:]
    said = {}
    for line in done.stdout.splitlines():
        then, *about = json.loads(line)
        said[then] = about if said.get(then) is None else [*said[then], *about]
    return said


def sums(side):
    """The sum of the state, and that of the picture."""
    picture = np.random.default_rng(side).uniform(-1, 1, (side, side))
    ran = cnnum.Engine("reference").run(
        cnnum.get_template("DIFFUS"), input=picture, method="euler", dt=0.1, duration=1.0
    )
    return {True: float(ran.state.sum()), False: float(picture.sum())}


def wrong(then, said, side, engine):
    """Return the fault in the answer of a child; nothing if it is right."""
    runs = then in ("old engine", "new engine", "any engine", "parent")
    # float32: ten steps of numbers within ±1, each rounded to 6e-8, in all cells
    right = said[:1] == [engine] and abs(said[1] - sums(side)[runs]) < 1e-6 * side**2
    return "" if right and len(said) == 2 else f"{then}: {said}"


def judged(faults, first, judge):
    with ThreadPoolExecutor(2) as pool:
        chosen = list(faults.each(CASES, short=3))
        for case, said in zip(chosen, pool.map(lambda c: played((first, *c)), chosen), strict=True):
            for then, answer in said.items():
                if why := judge(then, answer, case[1]):
                    faults.lose(f"{case}: {why}")


@pytest.mark.in_full("test_no_module_of_the_working_folder_runs")
def test_children_after_opencl(faults):
    """A child forked after OpenCL was used refuses it with one sentence; `Engine()` runs there."""
    if cnnum.Engine().name != "opencl":
        pytest.skip("this test is about OpenCL")

    def judge(then, said, side):
        if then in ("any engine", "parent"):
            return wrong(then, said, side, "numba" if then == "any engine" else "opencl")
        refused = said[0] == "NoOpenCLError" and "forked from one that had used it" in said[1]
        return "" if refused and len(said) == 2 else f"{then}: {said}"

    judged(faults, "opencl", judge)


@pytest.mark.in_full("test_no_module_of_the_working_folder_runs")
def test_children_after_numba(faults):
    """A child forked after the engine `numba` was used runs it, with the right numbers."""

    def judge(then, said, side):
        engine = "numba" if then != "any engine" else cnnum.Engine().name
        return wrong(then, said, side, engine)

    judged(faults, "numba", judge)


HOSTILE = ("json", "numpy", "pyopencl", "multiprocessing", "runpy", "pickle", "subprocess", "cnnum")
RUNS = (
    (True, ("devices", "--no-measure")),
    (False, ("templates", "show", "EDGE")),
    (False, ("stability", "layers-1", "--engine", "reference")),
)


def test_no_module_of_the_working_folder_runs(faults, tmp_path):
    """A module in the working folder that is named as one of a library's never runs."""
    for name in HOSTILE:
        mark = tmp_path / "ran" / name
        (tmp_path / f"{name}.py").write_text(f"open({str(mark)!r}, 'w')\nraise SystemExit(9)\n")
    (tmp_path / "ran").mkdir()
    command = Path(sys.executable).with_name("cnnum")
    for fresh, words in faults.each(RUNS, short=1):
        done = subprocess.run(
            [command, *words],
            cwd=tmp_path,
            # without verdicts of devices, each is tried in a child
            env=os.environ | {"PYTHONPATH": ""} | ({"CNNUM_CACHE": "off"} if fresh else {}),
            capture_output=True,
            text=True,
        )
        if done.returncode or list((tmp_path / "ran").iterdir()):
            ran = [mark.name for mark in (tmp_path / "ran").iterdir()]
            faults.lose(f"{words}: {done.returncode}, ran {ran}: {done.stderr[-300:]}")


POOL = """
if __name__ == "__main__":
    from cnnum.lab.scoring import family_tables
    with family_tables._workers() as workers:
        print(workers.submit(pow, 2, 3).result())
"""
PICTURE = """
import sys
from pathlib import Path
import numpy as np
from cnnum.report import plots
plots.draw(Path(sys.argv[1]), {"rest": np.zeros((4, 4, 1))}, ("x",), "N")
"""


def test_scenes_for_scores_are_drawn_by_no_module_of_the_working_folder(tmp_path):
    """The processes that draw them start as a script does, without the flag -P."""
    script, folder = tmp_path / "own" / "script.py", tmp_path / "others"
    for place in (script.parent, folder):
        place.mkdir()
    script.write_text(POOL)
    for name in HOSTILE:
        (folder / f"{name}.py").write_text("open('ran', 'w')\nraise SystemExit(9)\n")
    done = subprocess.run(
        [sys.executable, script], cwd=folder, capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.returncode) == ("8\n", 0), done.stderr[-300:]
    assert not (folder / "ran").exists()


def test_a_matplotlibrc_in_the_working_folder_starts_no_program(tmp_path):
    """With `text.usetex` Matplotlib would run what is called latex on every figure."""
    (tmp_path / "matplotlibrc").write_text("text.usetex : True\nbackend : module://evil\n")
    latex = tmp_path / "bin" / "latex"
    latex.parent.mkdir()
    latex.write_text(f"#!/bin/sh\ntouch {tmp_path}/ran\nexit 1\n")
    latex.chmod(0o700)
    done = subprocess.run(
        [sys.executable, "-P", "-c", PICTURE, "drawn.png"],
        cwd=tmp_path,
        env=os.environ | {"PATH": f"{latex.parent}{os.pathsep}{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, (tmp_path / "ran").exists()) == (0, False), done.stderr[-300:]
    assert (tmp_path / "drawn.png").is_file()
