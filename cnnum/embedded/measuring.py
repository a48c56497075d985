"""The range of every value, from a run in double precision on frames like those to come."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cnnum.arrays import Floats
from cnnum.embedded.emulator import Emulator, cleared
from cnnum.embedded.formats import Precision, precision_named
from cnnum.embedded.lowering.schedules import lower
from cnnum.embedded.needed import needed_sizes
from cnnum.embedded.program import array_names
from cnnum.embedded.sizes import NoFormats, Sizes
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solver

WARMING = 8
"""First frames of a stream, in which memories are empty."""

REALS = precision_named("float32")


@dataclass(frozen=True, slots=True)
class Seen:
    """The largest magnitude of every variable and array.

    Attributes
    ----------
    later, early : dict of str to float
        Of values that count; and of those in the first frames.
    idle : dict of str to float
        Of all values: of use where none counted.
    """

    later: dict[str, float] = field(default_factory=dict[str, float])
    early: dict[str, float] = field(default_factory=dict[str, float])
    idle: dict[str, float] = field(default_factory=dict[str, float])

    def sizes(self, precision: Precision) -> Sizes:
        """Return the formats of a precision."""
        never = {
            name: size
            for name, size in self.idle.items()
            if not self.later.get(name) and not self.early.get(name)
        }
        return Sizes(precision, self.later | never, self.early)


def measured(schedule: Schedule, solvers: Mapping[int, Solver], frames: Floats) -> Seen:
    """Return the largest magnitudes, by which each value gets its format.

    Parameters
    ----------
    schedule : Schedule
    solvers : mapping of int to Solver
    frames : (frames, batch, rows, cols, channels) float
        Streams side by side; channels are all of the schedule's.
    """
    program = lower("measured", schedule, solvers, NoFormats(REALS))
    found, state = Seen(), cleared(program, frames.shape[1])
    for number, frame in enumerate(frames):
        emulator = Emulator(program, sizes={})
        assert emulator.sizes is not None
        inputs = inputs_of(schedule, frame)
        emulator.run(inputs, state, first=number == 0, batch=len(frame))
        _raise(found.idle, emulator.sizes)
        emulator.sizes |= needed_sizes(schedule, emulator.values)
        counts = number >= WARMING or number == len(frames) - 1
        _raise(found.later if counts else found.early, emulator.sizes)
    for name, array in _inputs(schedule).items():
        at = schedule.channels.index(name)
        found.later[array] = float(np.abs(frames[..., at]).max())
    return found


def _raise(known: dict[str, float], sizes: Mapping[str, float]) -> None:
    for name, size in sizes.items():
        known[name] = max(size, known.get(name, 0.0))


def inputs_of(schedule: Schedule, frame: Floats) -> dict[str, Floats]:
    """Return the channels that are read of a batch of frames, (batch, cells) each."""
    return {
        array: frame[..., schedule.channels.index(name)].reshape(len(frame), -1)
        for name, array in _inputs(schedule).items()
    }


def _inputs(schedule: Schedule) -> dict[str, str]:
    """Return the arrays of the channels that are read."""
    arrays = array_names("in", schedule.channels)
    return {name: arrays[name] for name in schedule.channels_read}
