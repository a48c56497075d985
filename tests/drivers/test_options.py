"""Options: from a scene's table to a record, refused with the key in the sentence."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest

from cnnum.drivers import driver_names, driver_options, open_driver
from cnnum.drivers.options import read_options, require
from cnnum.drivers.registry import DRIVERS
from cnnum.errors import RecordingError, SceneError, UnknownNameError


@dataclass(frozen=True, slots=True)
class Inner:
    kind: Literal["a", "b"]
    amount: float = 1.0


@dataclass(frozen=True, slots=True)
class Outer:
    path: Path
    count: int = 3
    rate: float | None = None
    shape: tuple[int, int] = (8, 8)
    inners: tuple[Inner, ...] = ()
    pad: Literal[1, 2, "both"] = "both"

    def __post_init__(self) -> None:
        require("count", self.count > 0, "above 0", self.count)


def test_a_table_becomes_a_record(tmp_path: Path) -> None:
    table = {
        "path": "a/b",
        "rate": 200,
        "shape": [4, 6],
        "pad": 2,
        "inners": [{"kind": "a"}, {"kind": "b", "amount": 2}],
    }
    expected = Outer(tmp_path / "a/b", 3, 200.0, (4, 6), (Inner("a"), Inner("b", 2.0)), 2)
    got = read_options(Outer, table, tmp_path)
    assert got == expected
    assert isinstance(got.rate, float)


def test_an_absolute_path_stays(tmp_path: Path) -> None:
    assert read_options(Outer, {"path": str(tmp_path)}, Path("elsewhere")).path == tmp_path


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ({}, "'path' is missing"),
        ({"path": "x", "cuont": 1}, "Unknown option 'cuont'.*'count'"),
        ({"path": 3}, "'path' must be a path, got 3"),
        ({"path": "x", "count": 2.5}, "'count' must be a whole number, got 2.5"),
        ({"path": "x", "count": True}, "'count' must be a whole number, got True"),
        ({"path": "x", "count": 0}, "'count' must be above 0, got 0"),
        ({"path": "x", "rate": "fast"}, "'rate' must be a number, got 'fast'"),
        ({"path": "x", "shape": [8]}, "'shape' must be a list of 2 items"),
        ({"path": "x", "shape": "88"}, "'shape' must be a list"),
        ({"path": "x", "shape": [8, "x"]}, r"'shape\[1\]' must be a whole number"),
        ({"path": "x", "pad": True}, "'pad' must be one of 1, 2, 'both', got True"),
        ({"path": "x", "inners": [{"kind": "c"}]}, "'kind' must be one of 'a', 'b'"),
        ({"path": "x", "inners": [5]}, r"'inners\[0\]' must be a table"),
    ],
)
def test_what_is_wrong_is_named(table: dict[str, object], sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence):
        read_options(Outer, table, Path())


def test_every_registered_driver_has_a_record_that_refuses_nonsense(tmp_path: Path) -> None:
    assert driver_names() == tuple(DRIVERS)
    for name in driver_names():
        with pytest.raises(SceneError, match=f"Driver '{name}': unknown option 'nonsense'"):
            driver_options(name, {"nonsense": 1}, base=tmp_path)


def test_an_unknown_driver_is_answered_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="'simulated', 'serial', 'uskin-csv'"):
        open_driver("uskin")


def test_a_missing_trial_is_named_with_its_key(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"'path' must name the folder.*no folder '.*gone'"):
        open_driver("uskin-csv", {"path": "gone"}, base=tmp_path)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({}, "'port' is missing"),
        ({"port": "p", "baud": 0}, "'baud' must be"),
        ({"port": "p", "timeout": 0}, "'timeout' must be"),
        ({"port": "p", "reconnects": -1}, "'reconnects' must be"),
        ({"port": "p", "backoff": 9}, "'longest_backoff' must be"),
        ({"port": "p", "mode": "some"}, "'mode' must be one of 'every', 'latest'"),
        ({"port": "p", "depth": 0}, "'depth' must be"),
    ],
)
def test_serial_options_are_checked_before_the_port_is(
    options: dict[str, object], sentence: str
) -> None:
    with pytest.raises(SceneError, match=sentence):
        open_driver("serial", options)
