"""Break the code on purpose, one fault at a time, and show that the tests see each: `make mutate`.

The faults are records in `mutations.toml`. Each is put into a scratch copy of the project. There
the tests that must catch it run until the first fails. It ends with 1 where a fault survives.

    python tests/mutations/run.py            # all
    python tests/mutations/run.py slip noise # those whose name or file has one of the words
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
LIST = Path(__file__).with_name("mutations.toml")
PATIENCE_S = 300.0
"""s after which tests that do not end count as a fault that was caught."""

COPIED = ("cnnum", "docs", "drivers", "templates", "tests", "pyproject.toml", "README.md")


@dataclass(frozen=True, slots=True)
class Mutation:
    """A fault, and the tests that must catch it or why it changes nothing."""

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...] = ()
    equivalent: str = ""


def mutations(path: Path = LIST) -> list[Mutation]:
    """Return the list."""
    records = tomllib.loads(path.read_text())["mutation"]
    return [Mutation(**record | {"tests": tuple(record.get("tests", ()))}) for record in records]


def faults(listed: Sequence[Mutation], root: Path = ROOT) -> list[str]:
    """Return the faults of a list: it must fit the code as it stands."""
    found = []
    names = [one.name for one in listed]
    found += [f"'{name}' is listed twice" for name in {n for n in names if names.count(n) > 1}]
    for one in listed:
        path = root / one.file
        times = path.read_text().count(one.old) if path.is_file() else 0
        if times != 1:
            found.append(
                f"'{one.name}': its old text stands in '{one.file}' {times} times, not once"
            )
        if one.old == one.new:
            found.append(f"'{one.name}' changes nothing")
        if bool(one.tests) == bool(one.equivalent):
            found.append(f"'{one.name}' needs tests, or a reason why it is equivalent")
        for test in one.tests:
            file, _, function = test.partition("::")
            at = root / file
            known = at.exists() and (not function or f"def {function}(" in at.read_text())
            if not known:
                found.append(f"'{one.name}': there is no test '{test}'")
    return found


def copy(root: Path, scratch: Path) -> None:
    """Copy the files that the tests need."""
    ignored = shutil.ignore_patterns("__pycache__", "_build", ".*")
    for name in COPIED:
        source = root / name
        if source.is_dir():
            shutil.copytree(source, scratch / name, symlinks=True, ignore=ignored)
        else:
            shutil.copy(source, scratch / name)


@contextmanager
def broken(one: Mutation, scratch: Path) -> Iterator[None]:
    """Put a fault into the copy, and take it out again."""
    path = scratch / one.file
    before = path.read_text()

    def write(text: str) -> None:
        path.write_text(text)
        # compiled files know their source by its time and size alone
        for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*"):
            compiled.unlink()

    write(before.replace(one.old, one.new))
    try:
        yield
    finally:
        write(before)


def run_tests(
    tests: Sequence[str], scratch: Path, patience: float = PATIENCE_S
) -> tuple[bool, str]:
    """Return whether tests pass in the copy, and the first that does not."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "--tb=no", "-p"]
    command += ["no:cacheprovider", *tests]
    own = {"PYTHONPATH": str(scratch), "CNNUM_CACHE": str(scratch / "cache")}
    try:
        done = subprocess.run(
            command,
            cwd=scratch,
            env=os.environ | own,
            capture_output=True,
            text=True,
            timeout=patience,
        )
    except subprocess.TimeoutExpired:
        return False, f"no end in {patience:g} s"
    said = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    lines = (done.stdout + done.stderr).strip().splitlines()[-1:]
    failed = said[0].split(" - ")[0] if said else " ".join(lines)[:200]
    # 5: nothing was collected, which catches nothing
    return done.returncode in (0, 5), failed.replace("FAILED ", "")


def main(words: Sequence[str] = ()) -> int:
    """Run the list, print the table, and return the exit code."""
    listed = mutations()
    wrong = faults(listed)
    if wrong:
        print("\n".join(wrong))
        return 1
    wanted = [one for one in listed if not words or any(w in one.name + one.file for w in words)]
    with tempfile.TemporaryDirectory(prefix="cnnum-mutations-") as folder:
        scratch = Path(folder)
        copy(ROOT, scratch)
        tests = sorted({test.partition("::")[0] for one in wanted for test in one.tests})
        passes, failed = run_tests(tests, scratch, 4.0 * PATIENCE_S) if tests else (True, "")
        if not passes:
            print(f"The tests fail without any fault: {failed}")
            return 1
        outcomes = [_outcome(one, scratch) for one in wanted]
    survivors = outcomes.count("SURVIVED")
    equal = outcomes.count("equivalent")
    print(
        f"{len(outcomes)} faults: {len(outcomes) - survivors - equal} caught, {equal} equivalent,"
    )
    print(f"{survivors} survived")
    return 1 if survivors else 0


def _outcome(one: Mutation, scratch: Path) -> str:
    begin = time.perf_counter()
    outcome, by = "equivalent", one.equivalent
    if not by:
        with broken(one, scratch):
            passes, by = run_tests(one.tests, scratch)
        outcome = "SURVIVED" if passes else "caught"
    seconds = time.perf_counter() - begin
    print(f"{outcome:>10}  {seconds:5.1f} s  {one.name}  [{one.file}]  {by}", flush=True)
    return outcome


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*", help="words in the names or files of faults")
    sys.exit(main(parser.parse_args().words))
