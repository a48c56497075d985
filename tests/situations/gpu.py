"""The engine on a graphics processor: its tests, then throughput, latency and answers.

    python tests/situations/gpu.py [NAME]

NAME is a part of the name of a device; without one it is the first GPU that works. The parts share
five minutes, and a part that runs out of its time is stopped: a measurement prints the rows that it
has, tests count as failed. Tables and data are left in the folder bench-results.
"""

import json
import os
import signal
import subprocess
import sys
import time

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


def main() -> int:
    name = sys.argv[1] if len(sys.argv) > 1 else the_gpu()
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


if __name__ == "__main__":
    sys.exit(main())
