"""XELA uSkin: the JSON messages of its server, one per line, over a WebSocket or any stream.

Source: the public ROS node ``xela_server_ros``. A message has a counter and one object per
sensor. A taxel's x, y and z are hexadecimal, row by row from the top left.
"""

import json
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.drivers.codecs.stream import MORE, Decoder, Found, Neighbours, Scan, Skip
from cnnum.drivers.codecs.wire import Asked, Form, Wire
from cnnum.errors import CodecError
from cnnum.frame import FORCE_AXES

LONGEST = 1 << 17
"""Bytes of the longest message."""

TRIED = 4
"""Places of a line at which a message is looked for."""

TOP = 65_535
"""The largest count."""

PADS = {16: (4, 4), 24: (4, 6)}
"""Rows and columns of a pad by its number of taxels: uSPa44 and uSPa46."""


def xela(options: Asked) -> Wire:
    """Return the protocol; pads lie side by side, or fill the shape that the user gives."""
    server = Server(options.shape)
    form = Form(options.shape or (4, 4), FORCE_AXES, "count", 32_768.0, 45_000.0)
    return Wire(
        "XELA's server messages",
        115_200,
        lambda: Decoder(server, Neighbours(form.full - form.rest)),
        encode,
        form=form,
        verified=False,
    )


class Server:
    """The format: a line contains a message, a greeting, or something unknown.

    Parameters
    ----------
    shape : (rows, cols), optional
        Shape of all pads together, row by row in the order of their numbers, or of the only pad
        with that size.

    Attributes
    ----------
    trouble : str
        Why the last complete message gave no scan; empty if it did.
    """

    def __init__(self, shape: Shape | None = None) -> None:
        self._shape = shape
        self.trouble = ""

    def look(self, data: bytearray, *, locked: bool, ended: bool) -> Found | Skip | None:
        """Return the scan, gap or wait at the front of `data`."""
        end = data.find(b"\n") + 1 or (len(data) if ended else 0)
        if not end:
            return Skip(1) if len(data) > LONGEST else MORE
        line = bytes(data[:end])
        if not line.strip():
            return Found(end)
        at = -1
        for _ in range(TRIED):
            at = line.find(b"{", at + 1)
            if at < 0:
                break
            message = _message(line[at:])
            if message is not None:
                return Skip(at) if at else self._found(message, end)
        return Skip(end, bad=b'"message"' in line)

    def _found(self, message: dict[str, object], size: int) -> Found | Skip:
        if message["message"] == "Welcome":
            return Found(size)
        try:
            scan = scan_of(message, self._shape)
            self.trouble = ""
            return Found(size, scan)
        except CodecError as error:
            self.trouble = str(error)
            return Skip(size, bad=True)
        except (ValueError, TypeError, KeyError, OverflowError, AttributeError):
            return Skip(size, bad=True)


def _message(line: bytes) -> dict[str, object] | None:
    try:
        result: Any = json.loads(line)
    except (ValueError, RecursionError):
        return None
    known = isinstance(result, dict) and "message" in result
    return cast("dict[str, object]", result) if known else None


def scan_of(message: dict[str, object], shape: Shape | None = None) -> Scan:
    """Return the scan of a message, as calibrated forces if it has them, otherwise as counts.

    Raises
    ------
    CodecError
        If a sensor does not have three numbers per taxel, or the pads do not fill the shape.
    """
    keys = sorted(filter(str.isdigit, message), key=int)
    sensors = [cast("dict[str, Any]", message[key]) for key in keys]
    if not sensors:
        raise CodecError("A message needs an object for each of its sensors.")
    calibrated = all(sensor.get("calibrated") for sensor in sensors)
    pads = [_pad(sensor, calibrated=calibrated) for sensor in sensors]
    counter = message["message"]
    if not isinstance(counter, int) or counter < 0:
        raise CodecError("The counter of a message must be a number of at least 0.")
    values = tiled(pads, shape)
    at_end = np.asarray(((values >= TOP) | (values <= 0)).any(axis=-1))
    saturated = not calibrated and bool(at_end.any())
    return Scan(
        values=values,
        saturated=saturated,
        at_end=at_end if saturated else None,
        channels=FORCE_AXES,
        unit="N" if calibrated else "count",
        sequence=counter,
        sequence_wrap=1 << 63,
        time_us=round(1e6 * float(sensors[0]["time"])),
    )


def _pad(sensor: dict[str, Any], *, calibrated: bool) -> Floats:
    taxels = int(sensor["taxels"])
    rows, cols = PADS.get(taxels, (1, taxels))
    if calibrated:
        numbers = [float(value) for value in sensor["calibrated"]]
    else:
        numbers = [float(int(value, 16)) for value in str(sensor["data"]).split(",")]
    values = np.array(numbers)
    if len(numbers) != 3 * taxels or not taxels or not np.isfinite(values).all():
        raise CodecError(f"A sensor of {taxels} taxels needs {3 * taxels} finite numbers.")
    return values.reshape(rows, cols, 3)


def tiled(pads: list[Floats], shape: Shape | None) -> NDArray[np.float64]:
    """Return pads as one array: side by side, or row by row in a shape.

    If the pads have several sizes, all pads of the one size that fills the shape are used.

    Raises
    ------
    CodecError
        If the pads have different sizes, or do not fill the shape.
    """
    sizes = list(dict.fromkeys(pad.shape[:2] for pad in pads))
    alike = [[pad for pad in pads if pad.shape[:2] == size] for size in sizes]
    if len(sizes) > 1:
        fit = [some for some in alike if shape is not None and _across(some, shape)]
        if len(fit) != 1:
            seen = " and ".join(f"{rows}×{cols}" for rows, cols in sizes)
            count, (rows, cols) = len(alike[0]), sizes[0]
            what = f"{count} pads of {rows}×{cols} side by side" if count > 1 else "the first"
            raise CodecError(
                f"The server has pads of {seen} taxels, which do not form one array: set 'shape' "
                f"to that of the pads of one size, as in shape = {[rows, cols * count]} for "
                f"{what}, or give each size a server of its own."
            )
        pads = fit[0]
    rows, cols = pads[0].shape[:2]
    whole = shape or (rows, cols * len(pads))
    across = _across(pads, whole)
    if not across:
        raise CodecError(
            f"{len(pads)} pads of {rows}×{cols} taxels do not fill an array of "
            f"{whole[0]}×{whole[1]}."
        )
    return np.concatenate(
        [np.concatenate(pads[n : n + across], axis=1) for n in range(0, len(pads), across)]
    )


def _across(pads: list[Floats], shape: Shape) -> int:
    """Return how many pads of one size lie side by side in a shape; 0 where they do not fill it."""
    rows, cols = pads[0].shape[:2]
    down, across = shape[0] // rows, shape[1] // cols
    return across if (down * rows, across * cols, down * across) == (*shape, len(pads)) else 0


def encode(scan: Scan) -> bytes:
    """Return the line of a scan: 4×4 pads of unsigned counts, clipped at 16 bits.

    Raises
    ------
    CodecError
        If the scan is not made of 4×4 pads of three axes.
    """
    rows, cols, axes = scan.values.shape
    if rows % 4 or cols % 4 or axes != 3:
        raise CodecError(f"The server sends 4×4 pads of three axes, got {scan.values.shape}.")
    counts = np.clip(np.rint(np.asarray(scan.values, np.float64)), 0, 65_535).astype(int)
    message: dict[str, object] = {"message": scan.sequence or 0}
    for number in range(rows * cols // 16):
        row, col = divmod(number, cols // 4)
        pad = counts[4 * row : 4 * row + 4, 4 * col : 4 * col + 4].ravel().tolist()
        message[str(number + 1)] = {
            "sensor": number + 1,
            "time": (scan.time_us or 0) / 1e6,
            "model": "uSPa44",
            "taxels": 16,
            "data": ",".join(f"{value:04X}" for value in pad),
            "calibrated": None,
        }
    return json.dumps(message).encode() + b"\n"
