"""A recording of the simulated array, and frames made up."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cnnum.frame import FORCE_AXES, Frame, Quality, Truth
from cnnum.recordings.journal import Journal

Scans = Callable[..., list[Frame]]


@pytest.fixture
def scans() -> Scans:
    def made(count: int, first: int = 0, shape: tuple[int, int] = (2, 3)) -> list[Frame]:
        rng = np.random.default_rng(first)
        return [
            Frame(
                values=rng.normal(size=(*shape, 3)),
                channels=FORCE_AXES,
                unit="N",
                sequence=n,
                time=n / 100.0,
                quality=Quality(n % 3) | (Quality.SATURATED if n % 4 == 3 else Quality.GOOD),
                truth=Truth({"load": n * 0.1, "ß": float("nan") if n == 1 else -0.0}),
                # of every other one of these it is not known which taxels it is
                saturated=rng.random(shape) < 0.7 if n % 8 == 3 else None,
            )
            for n in range(first, first + count)
        ]

    return made


@pytest.fixture
def recorded(tmp_path: Path, scans: Scans) -> Path:
    """A whole recording of twenty frames."""
    path = tmp_path / "whole.mcap"
    journal = Journal(path, 100.0, None)
    for frame in scans(20):
        journal.add(frame)
    journal.close(index=True)
    assert journal.failure is None
    return path
