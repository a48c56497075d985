"""The engine on other implementations of OpenCL: a GPU, a simulator, Mesa's, and Intel's.

    python tests/situations/other_opencl.py gpu [NAME]
    python tests/situations/other_opencl.py portability [oclgrind] [rusticl] [intel]

`gpu` runs a part of the engine's tests, then throughput, latency and answers, on the device with
NAME in its name, or on the first GPU that works. The parts share five minutes, and one that runs
out of its time is stopped: a measurement prints the rows that it has, tests count as failed. Tables
and data are left in the folder bench-results.

`portability` runs tests on each implementation that is installed, for an hour or more: on Oclgrind,
which looks for reads of what was never written, for races, and for places beyond the bounds; on
Mesa's rusticl over llvmpipe, a device with vectors of 1 and without float64; and on Intel's
runtime, which the extra `intel` brings.
"""

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

LIMIT = 300.0
"""Seconds that all parts have together."""

CNNUM = [sys.executable, "-m", "cnnum"]
TESTS = [
    f"tests/engines/{name}.py"
    for name in ("test_agreement", "test_template_batches", "programs/test_machine")
]
WORKERS = max(1, min(8, (os.cpu_count() or 2) - 1))


def the_gpu() -> str:
    """Return the name of the first GPU that works; leave with a sentence where there is none."""
    listed = subprocess.run(
        [*CNNUM, "devices", "--no-measure", "--json"], capture_output=True, text=True, check=False
    )
    if listed.returncode:
        sys.exit(listed.stderr.strip())
    devices = [json.loads(line) for line in listed.stdout.splitlines()]
    for device in devices:
        if device["kind"] == "GPU" and device["works"]:
            return str(device["device"])
    names = ", ".join(
        f"{device['device']} ({device['broken'] or device['kind']})" for device in devices
    )
    sys.exit(f"No GPU works with OpenCL here. The devices are: {names or 'none'}.")


def ran(command: list[str], name: str, patience: float) -> str:
    """Run a part, and say how it ended; one that is late is interrupted, so that it can sum up."""
    part = subprocess.Popen(command, env={**os.environ, "CNNUM_TEST_DEVICE": name})
    try:
        code = part.wait(patience)
    except subprocess.TimeoutExpired:
        part.send_signal(signal.SIGINT)
        try:
            part.wait(20.0)
        except subprocess.TimeoutExpired:
            part.kill()
            part.wait()
        return f"was stopped after {patience:.0f} s"
    return "passed" if code == 0 else f"failed with exit code {code}"


def on_gpu(names: list[str]) -> int:
    name = names[0] if names else the_gpu()
    bench = ["--quick", "--device", name, "--force", "--out", "bench-results"]
    tests = ["-q", "-p", "no:cacheprovider", "--numprocesses", str(WORKERS), *TESTS]
    parts = {
        "self-test": ([*CNNUM, "devices", "--self-test"], 60.0),
        "throughput": ([*CNNUM, "bench", "throughput", *bench], 60.0),
        "latency": ([*CNNUM, "bench", "latency", *bench], 60.0),
        "answers": ([*CNNUM, "bench", "answers", *bench], 30.0),
        "tests": ([sys.executable, "-m", "pytest", *tests], LIMIT),
    }
    began, rows, failed = time.monotonic(), list[str](), False
    for part, (command, limit) in parts.items():
        start = time.monotonic()
        patience = max(1.0, min(limit, LIMIT - (start - began)))
        print(f"\n== {part} on {name}", flush=True)
        ended = ran(command, name, patience)
        failed |= ended.startswith("failed") or (part == "tests" and ended != "passed")
        rows.append(f"{part:<12}{time.monotonic() - start:6.0f} s  {ended}")
    print(f"\nOn {name}:", *rows, sep="\n")
    return int(failed)


@dataclass(frozen=True)
class Other:
    """An implementation: its library, a part of its device's name, and what it is told.

    Attributes
    ----------
    library : str
        Its file; empty where cnnum finds it by itself.
    device : str
    tests : tuple of str
    told : dict of str to str
        Variables of the environment.
    """

    library: str
    device: str
    tests: tuple[str, ...]
    told: dict[str, str] = field(default_factory=dict)


LOG = "oclgrind.log"
FAULT = re.compile(r"[Uu]ninitialized|[Rr]ace|Invalid (?:read|write)|out of bounds", re.ASCII)
"""How Oclgrind begins to complain of a kernel; what it says of questions about devices is no fault
of a kernel."""

OTHERS = {
    "oclgrind": Other(
        "/usr/lib/oclgrind/liboclgrind-rt-icd.so",
        "Oclgrind",
        ("tests/engines/programs/test_machine.py", "tests/engines/couplings/test_couplings.py"),
        {"OCLGRIND_UNINITIALIZED": "1", "OCLGRIND_DATA_RACES": "1", "OCLGRIND_LOG": LOG},
    ),
    "rusticl": Other(
        "libRusticlOpenCL.so.1", "llvmpipe", ("tests/engines",), {"RUSTICL_ENABLE": "llvmpipe"}
    ),
    "intel": Other("", "Intel(R) OpenCL", ("tests/engines",)),
}


def on_others(names: list[str]) -> int:
    failed = False
    for name in names or list(OTHERS):
        other = OTHERS[name]
        with TemporaryDirectory() as folder:
            told = {**other.told, "CNNUM_TEST_DEVICE": other.device}
            if other.library:
                (Path(folder) / "other.icd").write_text(f"{other.library}\n")
                told["OCL_ICD_VENDORS"] = folder
            if "OCLGRIND_LOG" in told:
                told["OCLGRIND_LOG"] = str(Path(folder) / LOG)
            print(f"\n== {name}", flush=True)
            environment = {**os.environ, **told}
            listed = subprocess.run(
                [*CNNUM, "devices", "--no-measure", "--json"],
                capture_output=True, text=True, check=False, env=environment,
            )  # fmt: skip
            if other.device not in listed.stdout:
                print(f"Not installed here: no device is called '{other.device}'.")
                continue
            command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
            done = subprocess.run(
                [*command, "--numprocesses", str(WORKERS), *other.tests],
                env=environment,
                check=False,
            )
            log = Path(folder) / LOG
            faults = FAULT.findall(log.read_text()) if log.exists() else []
            print(f"{name}: exit code {done.returncode}, {len(faults)} complaints of kernels")
            failed |= bool(done.returncode or faults)
    return int(failed)


def main() -> int:
    kinds = {"gpu": on_gpu, "portability": on_others}
    if len(sys.argv) < 2 or sys.argv[1] not in kinds:
        sys.exit(f"Name one of: {', '.join(kinds)}.")
    return kinds[sys.argv[1]](sys.argv[2:])


if __name__ == "__main__":
    sys.exit(main())
