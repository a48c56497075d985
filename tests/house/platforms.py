"""Do the dependencies resolve on every platform? A table, from pip's own dry runs.

    python tests/house/platforms.py [PYTHON_VERSION]

pip takes markers as those of the machine that it runs on, without regard to `--platform`. So they
are evaluated here, for the dependencies that `pyproject.toml` names; those of dependencies are
pip's. Nothing is installed; exits with 1 if a platform cannot be resolved.
"""

import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
GLIBC = (34, 28, 27, 24, 17)
"""Minor versions of glibc 2 whose wheels a current Linux takes."""

PLATFORMS = {
    "Linux x86-64": (
        {"sys_platform": "linux", "platform_machine": "x86_64", "platform_system": "Linux"},
        [*(f"manylinux_2_{n}_x86_64" for n in GLIBC), "manylinux2014_x86_64"],
    ),
    "Linux aarch64": (
        {"sys_platform": "linux", "platform_machine": "aarch64", "platform_system": "Linux"},
        [*(f"manylinux_2_{n}_aarch64" for n in GLIBC), "manylinux2014_aarch64"],
    ),
    "macOS arm64": (
        {"sys_platform": "darwin", "platform_machine": "arm64", "platform_system": "Darwin"},
        [f"macosx_{n}_0_arm64" for n in (14, 13, 12, 11)],
    ),
    "Windows x64": (
        {"sys_platform": "win32", "platform_machine": "AMD64", "platform_system": "Windows"},
        ["win_amd64"],
    ),
}


def wanted(environment: dict[str, str]) -> list[str]:
    """Return the dependencies that a platform has, without their markers."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    found = [Requirement(text) for text in project["dependencies"]]
    here = [each for each in found if each.marker is None or each.marker.evaluate(environment)]
    return [f"{each.name}{each.specifier}" for each in here]


def resolved(environment: dict[str, str], tags: list[str], version: str) -> tuple[int, str]:
    """Return how many packages pip would install, and the OpenCL among them or the fault."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install"]
        command += ["--dry-run", "--quiet", "--only-binary=:all:", "--target", folder]
        command += ["--python-version", version, "--implementation", "cp", "--report", "-"]
        command += [f"--platform={tag}" for tag in tags]
        done = subprocess.run(
            [*command, *wanted(environment)], capture_output=True, text=True, check=False
        )
    if done.returncode:
        errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
        return 0, errors[0] if errors else "pip failed"
    packages = [item["metadata"]["name"] for item in json.loads(done.stdout)["install"]]
    pocl = [name for name in packages if name.startswith("pocl")]
    return len(packages), "with PoCL" if pocl else "without an OpenCL of its own"


def main(version: str) -> int:
    """Print the table; return 1 if a platform has no answer."""
    failed = False
    for name, (environment, tags) in PLATFORMS.items():
        count, what = resolved(environment, tags, version)
        failed |= not count
        print(f"{name:14}  Python {version}  {count:3} packages  {what}", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1] if len(sys.argv) > 1 else "3.12"))
