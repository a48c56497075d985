"""Running commands: in this process, or as a user does."""

import json
import os
import subprocess
import sys
from collections.abc import Callable

import pytest
from click.testing import CliRunner, Result

from cnnum.cli import main

Call = Callable[..., Result]
Shell = Callable[..., "subprocess.CompletedProcess[str]"]
WAIT = 120  # s after which a command counts as hung; none takes a tenth of it


@pytest.fixture
def call() -> Call:
    def run(*arguments: object) -> Result:
        return CliRunner().invoke(main, [str(argument) for argument in arguments])

    return run


@pytest.fixture
def shell() -> Shell:
    def run(*arguments: object, **environment: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [sys.executable, "-m", "cnnum", *map(str, arguments)],
            capture_output=True,
            text=True,
            timeout=WAIT,
            env={**os.environ, **environment},
        )

    return run


def records(text: str) -> list[dict]:
    """Every line as a JSON object; NaN and infinity are none."""

    def refuse(name: str) -> None:
        raise ValueError(f"{name} is not JSON")

    found = [json.loads(line, parse_constant=refuse) for line in text.splitlines()]
    assert all(isinstance(record, dict) for record in found)
    return found


@pytest.fixture(name="records")
def records_of() -> Callable[[str], list[dict]]:
    return records
