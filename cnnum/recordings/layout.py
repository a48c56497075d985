"""The layout of a recording's frames: it stands in every chunk, so each can be read alone."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from cnnum.arrays import Shape
from cnnum.errors import CalibrationError, CodecError
from cnnum.frame import Frame
from cnnum.tactile.taxel import Calibration, identity_of

KIND = "cnnum recording 2"
"""Of the MCAP recordings; the NumPy archives are of kind 1."""

MOST_VALUES = 1 << 22
"""Numbers of a frame, at most: 32 MiB, half of a chunk."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Shape and names of the frames of a recording.

    Attributes
    ----------
    shape : (rows, cols)
    channels : tuple of str
    unit : str
    rate : float, Hz
    truths : tuple of str
        Names of the ground truth; empty where there is none.
    calibration : str
        TOML text of the array's calibration; empty where it has none.
    marks : bool
        Whether the frames say which taxels stand at an end of their range; those of earlier
        versions do not.

    Raises
    ------
    CodecError
        If the shape is not positive, or a frame is too large.
    """

    shape: Shape
    channels: tuple[str, ...]
    unit: str
    rate: float
    truths: tuple[str, ...] = ()
    calibration: str = ""
    marks: bool = True

    def __post_init__(self) -> None:
        if min(*self.shape, len(self.channels)) < 1:
            raise CodecError(f"a frame needs rows, columns and channels, got {self.whole}.")
        if self.values > MOST_VALUES or len(self.truths) > MOST_VALUES:
            raise CodecError(f"a frame has at most {MOST_VALUES} numbers, got {self.whole}.")

    @classmethod
    def of(cls, frame: Frame, rate: float, calibration: Calibration | None) -> "Layout":
        """Return the layout of an array's frames, by the first of them."""
        return cls(
            shape=frame.shape,
            channels=tuple(frame.channels),
            unit=frame.unit,
            rate=float(rate),
            truths=tuple(frame.truth.values) if frame.truth else (),
            calibration="" if calibration is None else calibration.to_text(),
        )

    @property
    def calibration_id(self) -> str:
        """Id of the calibration, as `Calibration.identity` says it; empty where there is none."""
        return identity_of(self.calibration) if self.calibration else ""

    @property
    def whole(self) -> tuple[int, int, int]:
        """Rows, columns and number of channels."""
        return (*self.shape, len(self.channels))

    @property
    def values(self) -> int:
        """Numbers of a frame."""
        rows, cols, channels = self.whole
        return rows * cols * channels

    @property
    def message(self) -> np.dtype[np.void]:
        """A message in its chunk, byte by byte; header of the record, then CDR."""
        fields: list[tuple[Any, ...]] = [
            ("opcode", "u1"),
            ("length", "<u8"),
            ("channel", "<u2"),
            ("number", "<u4"),
            ("log_time", "<u8"),
            ("publish_time", "<u8"),
            ("encoding", "V4"),
            ("sequence", "<i8"),
            ("time", "<f8"),
            ("quality", "<u4"),
            ("count", "<u4"),
            ("values", "<f8", self.whole),
            ("truths", "<u4"),
        ]
        if self.truths:
            fields += [("padding", "V4"), ("truth", "<f8", (len(self.truths),))]
        if self.marks:
            fields += [("taxels", "<u4"), ("saturated", "u1", self.shape)]
        form: np.dtype[np.void] = np.dtype(cast(Any, fields))
        return form

    def metadata(self) -> dict[str, str]:
        """Return the layout as the metadata of an MCAP channel."""
        rows, cols = self.shape
        return {
            "kind": KIND,
            "rows": str(rows),
            "cols": str(cols),
            "channels": json.dumps(self.channels, ensure_ascii=False),
            "unit": self.unit,
            "rate": repr(self.rate),
            "truths": json.dumps(self.truths, ensure_ascii=False),
            "calibration": self.calibration,
            "marks": json.dumps(self.marks),
        }

    @classmethod
    def from_metadata(cls, held: Mapping[str, str]) -> "Layout":
        """Return the layout that the metadata of a channel describes.

        Raises
        ------
        CodecError
            If a key is missing or wrong.
        """
        if held.get("kind") != KIND:
            raise CodecError(f"'kind' must be '{KIND}', got {held.get('kind')!r:.60}.")
        try:
            return cls(
                shape=(int(held["rows"]), int(held["cols"])),
                channels=_names(held["channels"]),
                unit=held["unit"],
                rate=float(held["rate"]),
                truths=_names(held["truths"]),
                calibration=held["calibration"],
                marks=held.get("marks", "false") == "true",
            )
        except KeyError as error:
            raise CodecError(f"it has no {error}.") from None
        except CodecError:
            raise
        except (ValueError, RecursionError) as error:
            raise CodecError(f"its layout cannot be read: {error}.") from None

    def calibrated(self, path: Path) -> Calibration | None:
        """Return the array's calibration; `path` names the recording in an error.

        Raises
        ------
        CodecError
            If its text is no calibration.
        """
        if not self.calibration:
            return None
        try:
            return Calibration.from_text(self.calibration, path)
        except CalibrationError as error:
            raise CodecError(f"'{path}' is not a recording of cnnum: {error}") from None


def _names(text: str) -> tuple[str, ...]:
    found: Any = json.loads(text)
    if not isinstance(found, list) or not all(isinstance(n, str) for n in cast(Any, found)):
        raise ValueError(f"expected a list of names, got {text[:60]!r}")
    return tuple(cast(Any, found))
