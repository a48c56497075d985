"""Write `requirements.lock` anew: packages at the newest versions that fit, with their hashes.

    python tests/house/lock.py

uv resolves for all platforms and Python versions at once, and notes the hash of every file of a
release. The sections stand in the order of their names here, and `make` reads the file up to the
section that it has no need of. Run by `make lock`, in an environment with uv.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
OLDEST = "3.11.5"
"""Python that the lock is for: some packages leave out earlier ones of 3.11."""

RUN, DEV, OTHERS = "# to run:", "# to develop and test:", "# of other extras:"
OTHER_EXTRAS = (
    *("attrs", "cax", "flax", "foxglove-sdk", "imageio", "intel-cmplr-lib-rt", "intel-opencl-rt"),
    *("networkx", "optax", "rerun-sdk", "scikit-image", "taichi"),
)
"""Packages that tests use where they are installed, and no target of make installs."""

HEAD = """\
# Packages, versions and the hashes of their files, on all platforms. `make lock` writes it;
# `pip install --no-deps --require-hashes --requirement requirements.lock` reads it.
"""


def compiled(folder: Path, given: list[str], *options: str) -> list[str]:
    """Return the entries of a lock file: one of each package, of several lines."""
    out = folder / "out.txt"
    command = [sys.executable, "-m", "uv", "pip", "compile", "--quiet", "--universal"]
    command += ["--python-version", OLDEST, "--generate-hashes", "--no-header", "--no-annotate"]
    subprocess.run([*command, *given, *options, "--output-file", str(out)], cwd=ROOT, check=True)
    entries = re.split(r"\n(?! )", out.read_text().strip())
    out.unlink()
    return entries


def main() -> None:
    """Resolve the sections, each on top of those before it, and write them."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build, fixed, others = (folder / f"{each}.in" for each in ("build", "fixed", "others"))
        build.write_text("setuptools>=77\n")
        others.write_text("\n".join(OTHER_EXTRAS))
        run = compiled(folder, ["pyproject.toml", str(build)])
        fixed.write_text("\n".join(entry.partition(" ")[0] for entry in run))
        on_top = ("--constraint", str(fixed))
        dev = compiled(folder, ["pyproject.toml", str(build), "--extra", "dev"], *on_top)
        more = compiled(folder, [str(others)], "--no-deps")
    locked: set[str] = set()
    lines = [HEAD]
    for title, entries in ((RUN, run), (DEV, dev), (OTHERS, more)):
        new = [entry for entry in entries if entry.partition("==")[0] not in locked]
        locked |= {entry.partition("==")[0] for entry in new}
        lines += [title, *new]
    (ROOT / "requirements.lock").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
