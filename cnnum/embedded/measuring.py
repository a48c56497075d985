"""The range of every value, from a run in double precision on frames like those to come."""

from collections.abc import Mapping

import numpy as np

from cnnum.arrays import Floats
from cnnum.embedded.emulator import Emulator, cleared
from cnnum.embedded.formats import Precision
from cnnum.embedded.lowering.schedules import lower
from cnnum.embedded.program import array_name
from cnnum.embedded.sizes import NoFormats, Sizes
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Solver

WARMING = 8
"""First frames of a stream, in which memories are empty."""


def measured(
    schedule: Schedule, solvers: Mapping[int, Solver], precision: Precision, frames: Floats
) -> Sizes:
    """Return the formats that the largest magnitude of every variable and array asks for.

    Parameters
    ----------
    schedule : Schedule
    solvers : mapping of int to Solver
    precision : Precision
    frames : (frames, batch, rows, cols, channels) float
        Streams side by side; channels are all of the schedule's.
    """
    program = lower("measured", schedule, solvers, NoFormats(precision))
    sizes: dict[str, float] = {}
    early: dict[str, float] = {}
    state = cleared(program, frames.shape[1])
    for number, frame in enumerate(frames):
        inputs = inputs_of(schedule, frame)
        counts = number >= WARMING or number == len(frames) - 1
        emulator = Emulator(program, sizes=sizes if counts else early)
        emulator.run(inputs, state, first=number == 0)
    for name in schedule.channels_read:
        at = schedule.channels.index(name)
        sizes[array_name("in", name)] = float(np.abs(frames[..., at]).max())
    return Sizes(precision, sizes, early)


def inputs_of(schedule: Schedule, frame: Floats) -> dict[str, Floats]:
    """Return the channels that are read of a batch of frames, (batch, cells) each."""
    return {
        array_name("in", name): frame[..., schedule.channels.index(name)].reshape(len(frame), -1)
        for name in schedule.channels_read
    }
