"""A program in a precision: measured, lowered, emulated, or exported."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.embedded.c.files import Exported, Facts, exported
from cnnum.embedded.c.text import c_text
from cnnum.embedded.emulator import Emulator, Numbers, cleared
from cnnum.embedded.formats import NoFormats, Precision
from cnnum.embedded.lowering.builder import solvers_for
from cnnum.embedded.lowering.schedules import lower
from cnnum.embedded.measuring import REALS, Seen, inputs_of, measured
from cnnum.embedded.program import Array, IntegerProgram, array_names
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solver


@dataclass(frozen=True, slots=True, eq=False)
class Made:
    """A schedule in a precision.

    Attributes
    ----------
    schedule : Schedule
    precision : Precision
    method : str
    program : IntegerProgram
    shares : bool
        Whether working arrays share their places in C.
    """

    schedule: Schedule
    precision: Precision
    method: str
    program: IntegerProgram
    shares: bool = False

    @property
    def memory_bytes(self) -> int:
        """Bytes of persistent arrays and of working arrays."""
        return c_text(self.program, shares=self.shares, c99=True).memory_bytes

    def inputs(self, frames: Floats) -> dict[str, Numbers]:
        """Return the channels of a batch of frames in their formats, (batch, cells) each.

        Parameters
        ----------
        frames : (batch, rows, cols, channels) float
        """
        given = inputs_of(self.schedule, frames)
        return {
            name: quantised(self.program.arrays[name], values) for name, values in given.items()
        }

    def run(self, frames: Floats) -> dict[str, Floats]:
        """Return the outputs of streams that begin with the first frame.

        Parameters
        ----------
        frames : (frames, batch, rows, cols, channels) float

        Returns
        -------
        dict of str to (frames, batch, rows, cols) or (frames, batch) float
        """
        state, result = cleared(self.program, frames.shape[1]), list[dict[str, Floats]]()
        for number, frame in enumerate(frames):
            inputs = self.inputs(frame)
            answer = self.emulator().run(inputs, state, first=number == 0, batch=len(frame))
            result.append(self.outputs(answer))
        return {
            name: np.stack([outputs[name] for outputs in result]) for name in self.program.outputs
        }

    def emulator(self) -> Emulator:
        """Return the emulator that runs one frame."""
        return Emulator(self.program, single=not self.precision.integer)

    def outputs(self, answer: Mapping[str, Numbers]) -> dict[str, Floats]:
        """Return the outputs of a batch as real numbers."""
        result = dict[str, Floats]()
        for name, array in self.program.outputs.items():
            numbers = real(self.program.arrays[array], answer[array])
            shape = self.schedule.shape_of(self.schedule.outputs[name])
            result[name] = numbers.reshape(len(numbers), *shape)
        return result

    def export(
        self, frames: Floats, remarks: Sequence[str] = (), *, facts: Facts | None = None
    ) -> Exported:
        """Return the files of C99.

        Parameters
        ----------
        frames : (frames, rows, cols, channels) or (frames, streams, rows, cols, channels) float
            A stream for the test vector, or several among which it is chosen.
        about : sequence of str
            Lines at the head of the program's file.
        facts : Facts, optional
            What the header says of the frames.
        """
        streams = frames if frames.ndim == 5 else frames[:, np.newaxis]
        channels = array_names("in", self.schedule.channels)
        inputs = [self.inputs(frame) for frame in streams]
        return exported(self.program, inputs, remarks, facts, channels, shares=self.shares)

    def errors(self, frames: Floats) -> dict[str, float]:
        """Return the relative root mean square error of each output.

        Parameters
        ----------
        frames : (frames, batch, rows, cols, channels) float
            Typical streams.

        Returns
        -------
        dict of str to float
            Relative to the same program in floating point; infinity where that gives 0. Empty for
            a program in floating point.
        """
        if not self.precision.integer:
            return {}
        solvers, result = solvers_for(self.schedule, self.method), dict[str, float]()
        exact = make_with(self.program.name, self.schedule, solvers, REALS, Seen(), self.method)
        wanted, given = exact.run(frames), self.run(frames)
        for name, values in wanted.items():
            error = float(np.sqrt(np.mean((given[name] - values) ** 2)))
            size = float(np.sqrt(np.mean(values**2)))
            result[name] = error / size if size else (np.inf if error else 0.0)
        return result


def quantised(array: Array, values: Floats) -> Numbers:
    """Return numbers in the format of an array, halves up, saturated."""
    if array.format is None:
        return values.astype(np.float32).astype(np.float64)
    whole = np.floor(np.ldexp(values, array.format.fraction) + 0.5)
    return np.clip(whole, array.format.least, array.format.largest).astype(np.int64)


def real(array: Array, numbers: Numbers) -> Floats:
    """Return the real values of an array's numbers."""
    places = 0 if array.format is None else array.format.fraction
    return np.ldexp(numbers.astype(np.float64), -places)


def make(
    name: str, schedule: Schedule, precision: Precision, frames: Floats, method: str = "auto"
) -> Made:
    """Return a schedule in a precision, its ranges measured.

    Parameters
    ----------
    name : str
    schedule : Schedule
    precision : Precision
    frames : (frames, batch, rows, cols, channels) float
        Streams like those to come: the range of every value is measured on them.
    method : "auto" or "euler"

    Raises
    ------
    NotSupportedError
        If part of the schedule cannot be expressed in this precision.
    """
    solvers = solvers_for(schedule, method)
    seen = measured(schedule, solvers, frames) if precision.integer else Seen()
    return make_with(name, schedule, solvers, precision, seen, method)


def make_with(
    name: str,
    schedule: Schedule,
    solvers: Mapping[int, Solver],
    precision: Precision,
    seen: Seen,
    method: str = "auto",
) -> Made:
    """Return a schedule in a precision, each transient by its solver, each value by its range.

    Parameters and errors are otherwise those of `make`.
    """
    formats = seen.sizes(precision) if precision.integer else NoFormats(precision)
    return Made(schedule, precision, method, lower(name, schedule, solvers, formats))
