"""An exported program, compiled on this machine and run over frames and recordings."""

import ctypes
import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats, finite, real_numbers
from cnnum.embedded.c.files import MANIFEST
from cnnum.embedded.program import UNFINISHED
from cnnum.engines.notices import refuse_unfinished
from cnnum.errors import ArrayError, NotSupportedError, ProgramError, name_error, unreadable
from cnnum.recordings.recording import Recording
from cnnum.safety.reading import read_text

COMPILERS = ("cc", "gcc", "clang")

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC")
"""As the Makefile of an export, for a library that this process loads."""

NEAR = 0.01
"""Share by which the rate of a recording may differ from that of the program."""

MOST_RECORD = 2**24
"""Bytes of the file that describes an export."""

_LAYOUTS = {"float": "f4", "uint8_t": "u1", "int8_t": "i1", "int16_t": "i2", "int32_t": "i4"}

_SHIM = """#include "{name}.h"

int64_t cnnum_size(int32_t which);
void cnnum_run(void *memory, int32_t reset, const void *in, void *out, int64_t frames);

int64_t cnnum_size(int32_t which)
{{
    return which == 0 ? (int64_t)sizeof({name}_memory)
        : which == 1 ? (int64_t)sizeof({name}_input) : (int64_t)sizeof({name}_output);
}}

void cnnum_run(void *memory, int32_t reset, const void *in, void *out, int64_t frames)
{{
    if (reset) {{
        {name}_reset(({name}_memory *)memory);
    }}
    for (int64_t n = 0; n < frames; ++n) {{
        const {name}_input *frame = (const {name}_input *)in + n;
        {name}_step(({name}_memory *)memory, frame, ({name}_output *)out + n);
    }}
}}
"""


@dataclass(frozen=True, slots=True)
class Part:
    """A member of the structure of a frame, or of its answers.

    Attributes
    ----------
    name, member : str
        The channel or output, and its name in C.
    type : str
        C type.
    shape : tuple of int
        (rows, cols) of a map, () of a number.
    fraction : int or None
        A whole number q stands for q · 2^−fraction; None of reals.
    least, largest : int or None
        The range of an input; numbers beyond it are taken as its end.
    """

    name: str
    member: str
    type: str
    shape: tuple[int, ...]
    fraction: int | None = None
    least: int | None = None
    largest: int | None = None

    @property
    def field(self) -> tuple[str, str, tuple[int, ...]]:
        """The member as NumPy has it."""
        return self.member, _LAYOUTS[self.type], self.shape or (1,)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LoadedExport:
    """An export that runs on this machine; `cnnum.load_export` makes it.

    Attributes
    ----------
    program : str
    shape : (rows, cols)
    channels : tuple of str
        Channels of a frame, in order.
    rate : float or None
        Frames per second for which the time constants hold, or None if the program has none.
    unit : str
        Unit of the inputs, or empty.
    precision : str
    inputs, outputs : tuple of Part
    library : ctypes.CDLL
        The compiled code.
    """

    program: str
    shape: tuple[int, int]
    channels: tuple[str, ...]
    rate: float | None
    unit: str
    precision: str
    inputs: tuple[Part, ...]
    outputs: tuple[Part, ...]
    library: Any

    def __repr__(self) -> str:
        rows, cols = self.shape
        timed = "" if self.rate is None else f", {self.rate:g} frames per second"
        return f"LoadedExport({self.program}, {rows}×{cols}, {self.precision}{timed})"

    def stream(self) -> "ExportStream":
        """Return a stream with cleared memory."""
        return ExportStream(self)

    def run(self, frames: Recording | ArrayLike) -> dict[str, Floats]:
        """Run the program over frames from a cleared memory.

        Parameters
        ----------
        frames : Recording, or (frames, rows, cols, channels) float
            A recording supplies the channels by their names. An array contains the program's
            channels in order; the last axis may be left out if there is only one channel.

        Returns
        -------
        dict of str to (frames, rows, cols) or (frames,) float
            Outputs as real numbers. Those of fixed-point outputs are exact, so outputs that are
            equal here are equal to the bit.

        Raises
        ------
        ArrayError
            If the frames do not fit the program, or the recording has another rate.
        MethodError
            If a loop reaches its limit and the program does not read whether it finished.
        UnknownNameError
            If the recording has no such channel.
        """
        return self.stream().run(frames)

    def read(self, frames: Recording | ArrayLike) -> Floats:
        """Return frames as numbers, (frames, rows, cols, channels), as `run` takes them."""
        if isinstance(frames, Recording):
            rate = self.rate
            if rate is not None and abs(frames.rate - rate) > NEAR * rate:
                raise ArrayError(
                    f"The recording has {frames.rate:g} frames per second, and '{self.program}' "
                    f"was exported for {rate:g}: export it with --rate {frames.rate:g}, or pass "
                    "the recording's values alone to run it anyway."
                )
            known = frames.channels
            for name in self.channels:
                if name not in known:
                    raise name_error("channel", name, known)
            values = np.asarray(frames.values, dtype=np.float64)
            values = values.reshape(*values.shape[:3], len(known))
            values = values[..., [known.index(name) for name in self.channels]]
        else:
            values = np.asarray(real_numbers("frames", frames), dtype=np.float64)
            if values.ndim == 3 and len(self.channels) == 1:
                values = values[..., np.newaxis]
        if values.shape[1:] != (*self.shape, len(self.channels)):
            names = ", ".join(self.channels)
            raise ArrayError(
                f"'{self.program}' takes frames (frames, {self.shape[0]}, {self.shape[1]}, "
                f"{len(self.channels)}), with the channels {names}, got {values.shape}."
            )
        return finite("frames", values)


@dataclass(slots=True, eq=False, repr=False)
class ExportStream:
    """Frames of one array in time; owns the memory.

    Attributes
    ----------
    exported : LoadedExport
    frames : int
        Frames so far.
    limited : int
        Number of input values so far that lay beyond their range and were limited to it.
    """

    exported: LoadedExport
    frames: int = 0
    limited: int = 0
    _memory: Any = field(default=None)

    def __post_init__(self) -> None:
        # words of eight bytes, so that every member is aligned
        words = -(-_size(self.exported.library, 0) // 8)
        self._memory = np.zeros(words, dtype=np.int64)

    def push(self, frame: ArrayLike) -> dict[str, Floats]:
        """Run the program on the next frame.

        Parameters
        ----------
        frame : (rows, cols, channels) float
            The last axis may be left out if there is only one channel.

        Returns
        -------
        dict of str to (rows, cols) or () float

        Raises
        ------
        ArrayError
            If the frame does not fit the program.
        """
        answers = self.run(real_numbers("frame", frame)[np.newaxis])
        return {name: values[0] for name, values in answers.items()}

    def run(self, frames: Recording | ArrayLike) -> dict[str, Floats]:
        """Run the program on the next frames, as `LoadedExport.run` does."""
        exported = self.exported
        values = exported.read(frames)
        given = np.zeros(len(values), dtype=_layout(exported.inputs))
        for part in exported.inputs:
            numbers = values[..., exported.channels.index(part.name)]
            given[part.member] = self._whole(part, numbers).reshape(len(values), *part.shape)
        answers = np.zeros(len(values), dtype=_layout(exported.outputs))
        exported.library.cnnum_run(
            self._memory.ctypes.data_as(ctypes.c_void_p),
            ctypes.c_int32(int(self.frames == 0)),
            given.ctypes.data_as(ctypes.c_void_p),
            answers.ctypes.data_as(ctypes.c_void_p),
            ctypes.c_int64(len(values)),
        )
        self.frames += len(values)
        if UNFINISHED in (answers.dtype.names or ()):
            refuse_unfinished(answers[UNFINISHED][:, 0])
        return {
            part.name: _real(part, answers[part.member])
            for part in exported.outputs
            if part.member != UNFINISHED
        }

    def _whole(self, part: Part, values: Floats) -> NDArray[Any]:
        """Return numbers as the C takes them: halves up, saturated."""
        if part.fraction is None:
            with np.errstate(over="ignore"):
                single = values.astype(np.float32)
            if not np.isfinite(single).all():
                raise ArrayError(
                    f"Channel '{part.name}' reaches {np.abs(values).max():.3g}, more than float32 "
                    "holds: scale it down."
                )
            return single
        assert part.least is not None
        assert part.largest is not None
        whole = np.floor(np.ldexp(values, part.fraction) + 0.5)
        legal = np.clip(whole, part.least, part.largest)
        self.limited += int(np.count_nonzero(legal != whole))
        return legal.astype(np.int64)


def _real(part: Part, numbers: NDArray[Any]) -> Floats:
    shaped = numbers.astype(np.float64).reshape(len(numbers), *part.shape)
    return np.ldexp(shaped, -(part.fraction or 0))


def _layout(parts: tuple[Part, ...]) -> np.dtype[Any]:
    """Return the structure of the header: the members stand in its order."""
    fields: list[Any] = [part.field for part in parts]
    return np.dtype(fields or [("nothing", "u1")], align=True)


def _size(library: Any, which: int) -> int:
    return int(library.cnnum_size(ctypes.c_int32(which)))


def load_export(folder: str | PathLike[str]) -> LoadedExport:
    """Compile an export with the C compiler of this machine, so that it can be run.

    The compiler is that of the environment variable CC, or `cc`, `gcc` or `clang`. The code in the
    folder runs in this process, with your permissions.

    Parameters
    ----------
    folder : str or Path
        A folder that `cnnum export` wrote.

    Raises
    ------
    NotSupportedError
        If there is no C compiler.
    ProgramError
        If the folder contains no export, or its C code cannot be compiled or does not agree with
        its record.
    """
    place = Path(folder)
    record = _record(place)
    try:
        inputs, outputs = (
            tuple(_part(part, record["shape"]) for part in record[kind])
            for kind in ("inputs", "outputs")
        )
        layouts = _layout(inputs), _layout(outputs)
        rows, cols = (int(length) for length in record["shape"])
        rate, source = record["rate"], str(record["source"])
        words = [str(record[key]) for key in ("program", "unit", "precision")]
        channels = tuple(str(name) for name in record["channels"])
    except (TypeError, KeyError, ValueError):
        raise ProgramError(
            f"'{place / MANIFEST}' is not the record of an export{_ADVICE}."
        ) from None
    program, unit, precision = words
    with TemporaryDirectory(prefix="cnnum-", ignore_cleanup_errors=True) as work:
        library = _compiled(place / source, precision, Path(work))
    for which, layout in enumerate(layouts, 1):
        if _size(library, which) != layout.itemsize:
            raise ProgramError(
                f"'{place}' has structures in its header that differ from '{MANIFEST}': export "
                "the program again."
            )
    return LoadedExport(
        program, (rows, cols), channels, rate, unit, precision, inputs, outputs, library
    )


def _part(record: Mapping[str, Any], shape: Sequence[int]) -> Part:
    known = {key: value for key, value in record.items() if key != "map"}
    return Part(**known, shape=tuple(shape) if record["map"] else ())


_ADVICE = ": name a folder that 'cnnum export' of this version wrote"


def _record(place: Path) -> Mapping[str, Any]:
    try:
        text = read_text(place / MANIFEST, most=MOST_RECORD)
        return cast("Mapping[str, Any]", json.loads(text))
    except OSError as error:
        raise unreadable(ProgramError, f"'{place / MANIFEST}'", error, _ADVICE) from None
    except ValueError:
        raise ProgramError(f"'{place / MANIFEST}' is not JSON{_ADVICE}.") from None


def _compiled(source: Path, precision: str, work: Path) -> Any:
    """Return the loaded library of a program's C."""
    shim, library = work / "shim.c", work / f"{source.stem}.so"
    shim.write_text(_SHIM.format(name=source.stem), encoding="utf-8")
    math = ["-lm"] if precision == "float32" and sys.platform != "win32" else []
    command = [*_compiler(), *FLAGS, f"-I{source.parent.absolute()}", "-o", str(library)]
    try:
        done = subprocess.run(
            [*command, str(shim), str(source.absolute()), *math],
            capture_output=True,
            text=True,
            check=False,
            errors="replace",
        )
    except OSError as error:
        raise NotSupportedError(
            f"The C compiler '{command[0]}' cannot be started ({error.strerror}): set CC to "
            "another one."
        ) from None
    if done.returncode:
        said = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr)
        raise ProgramError(f"'{source}' cannot be compiled by '{command[0]}': {said.strip():.300}")
    return ctypes.CDLL(str(library))


def _compiler() -> list[str]:
    try:
        command = shlex.split(os.environ.get("CC", ""))
    except ValueError:
        raise NotSupportedError(
            f"CC must be a compiler's command, got {os.environ['CC']!r:.80}: a quotation is open."
        ) from None
    if command:
        return command
    path_of_compiler = next(
        (path for compiler in COMPILERS if (path := shutil.which(compiler))), None
    )
    if path_of_compiler is None:
        raise NotSupportedError(
            "An export is compiled before it runs here, and no C compiler was found (cc, gcc or "
            "clang): install one, such as the package 'gcc', or set CC."
        )
    return [path_of_compiler]
