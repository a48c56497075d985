"""Damage to files that looks where it leads: Atheris changes bytes so that new lines of code run.

    python tests/fuzz/guided.py 120           # seconds for all parsers together
    python tests/fuzz/guided.py 60 mcap csv   # some of them

The parsers and their first files are those of `test_parsers.py`. Each runs in a process of its own,
as Atheris ends the process. It ends with 1 where a parser raises anything but the project's own
errors. It names the file of bytes that did it.
"""

import importlib.util
import os
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from types import ModuleType

HERE = Path(__file__).parent
LARGEST = 65_536
"""Bytes of a case: the first files have up to some ten thousand."""

MEMORY_MB = 3072
"""That a process may have; more than it is a finding."""


def parsers() -> ModuleType:
    """Return the module of parsers and of their first files."""
    spec = importlib.util.spec_from_file_location("parsers", HERE / "test_parsers.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def fuzz(name: str, seconds: int, folder: Path) -> None:
    """Change bytes of one parser's first file until the time is over; ends the process."""
    import atheris

    with atheris.instrument_imports(include=["cnnum"]):
        known = parsers()
    from cnnum.errors import CnnumError

    make, parse = known.PARSERS[name]
    (folder / "first").write_bytes(make())

    def one(data: bytes) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                parse(data)
            except CnnumError as error:
                if "\n" in str(error):
                    raise AssertionError("It is not one sentence.") from error

    limits = [f"-max_total_time={seconds}", f"-max_len={LARGEST}", f"-rss_limit_mb={MEMORY_MB}"]
    out = Path(tempfile.gettempdir()) / f"cnnum-fuzz-{name.replace(' ', '-')}-"
    quiet = ["-timeout=20", "-verbosity=0", "-print_final_stats=1", f"-artifact_prefix={out}"]
    atheris.Setup([sys.argv[0], *limits, *quiet, str(folder)], one)
    atheris.Fuzz()


def main(seconds: float, names: list[str]) -> int:
    """Run every parser for its share of the time, and return the exit code."""
    if importlib.util.find_spec("atheris") is None:
        print(
            "Atheris is not here (it has wheels for Linux on x86-64): guided fuzzing is left out."
        )
        return 0
    chosen = names or list(parsers().PARSERS)
    share, failed = max(1, round(seconds / len(chosen))), 0
    print(f"{'tried':>8}{'survived':>10}{'lost':>6}  parser", flush=True)
    for name in chosen:
        with tempfile.TemporaryDirectory(prefix="cnnum-fuzz-") as folder:
            command = [sys.executable, __file__, "--one", name, str(share), folder]
            own = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
            done = subprocess.run(command, capture_output=True, text=True, env=own)
            lines = done.stderr.splitlines()
        ran = [int(line.split()[-1]) for line in lines if "number_of_executed_units" in line]
        tried, lost = max(sum(ran), 1), int(done.returncode != 0)
        print(f"{tried:>8}{tried - lost:>10}{lost:>6}  {name}", flush=True)
        if lost:
            failed += 1
            print("\n".join(lines[-25:]))
    return 1 if failed else 0


if __name__ == "__main__":
    if sys.argv[1] == "--one":
        fuzz(sys.argv[2], int(sys.argv[3]), Path(sys.argv[4]))
    else:
        sys.exit(main(float(sys.argv[1]), sys.argv[2:]))
