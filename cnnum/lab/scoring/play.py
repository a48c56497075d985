"""A play: one scene as it went, with what was reported and what was true."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.drivers.simulated.motion import scans
from cnnum.drivers.simulated.script import Phase
from cnnum.scenes.events import Event


@dataclass(frozen=True, slots=True)
class Span:
    """A stretch of frames in which the hand does one thing.

    Attributes
    ----------
    kind : str
        Of the phase: "grip", "roll"…
    first, after : int
        The first frame and the one after the last.
    """

    kind: str
    first: int
    after: int


@dataclass(frozen=True, slots=True, eq=False)
class Play:
    """One scene as it went.

    Attributes
    ----------
    name, suite : str
    seed : int or None
    shape : (rows, cols)
    rate : float, Hz
    pitch : float, m
    times : (frames,) float, s
    truth : mapping of str to (frames,) float
        As the simulated array gives it.
    outputs : mapping of str to (frames,) float
        Numbers and flags of the program; NaN where it did not run.
    events : tuple of Event
    phases : tuple of Span
        What the hand did; empty where nobody knows.
    traits : mapping of str to str
        What scenes are grouped by.
    about : mapping of str to object
        What sets the scene apart, for who looks into it.
    """

    name: str
    suite: str
    seed: int | None
    shape: Shape
    rate: float
    pitch: float
    times: Floats
    truth: Mapping[str, Floats]
    outputs: Mapping[str, Floats]
    events: tuple[Event, ...]
    phases: tuple[Span, ...] = ()
    traits: Mapping[str, str] = field(default_factory=dict[str, str])
    about: Mapping[str, object] = field(default_factory=dict[str, object])

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.times)

    @property
    def seconds(self) -> float:
        """How long the scene is, s."""
        return self.frames / self.rate

    def stick(self, frame: int) -> float:
        """Return the true c/a at a frame; NaN without contact."""
        radius = float(self.truth["contact_radius"][frame])
        return float(self.truth["stick_radius"][frame]) / radius if radius > 0 else float("nan")

    def centre(self, frame: int) -> tuple[float, float]:
        """Return the true centre of the contact at a frame, (row, column) in cells."""
        rows, cols = self.shape
        x, y = (float(self.truth[name][frame]) for name in ("x", "y"))
        return y / self.pitch + (rows - 1) / 2, x / self.pitch + (cols - 1) / 2


def spans_of(script: Sequence[Phase], rate: float) -> tuple[Span, ...]:
    """Return the frames of every phase of a script."""
    ends = np.cumsum([0, *(scans(phase, rate) for phase in script)]).tolist()
    return tuple(
        Span(phase.kind, first, after)
        for phase, first, after in zip(script, ends[:-1], ends[1:], strict=True)
    )
