"""The host's part in a plan for large arrays: launches, steps by strips, and loops."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Strips:
    """Launches of the steps of a large array.

    Attributes
    ----------
    kernel, text : str
        Name of the kernel, and its text.
    count : int
        Number of levels, which are all stages of all steps; the largest number if it depends on the
        frames.
    levels : int
        Number of levels per launch, if there is more than one strip.
    most : int
        Number of strips of an array that are high enough for a number of levels.
    alone : bool
        Whether a single strip needs nothing from beyond its end, so that one launch suffices.
    begins, ends : bool
        Whether the states are copied into the strips before, and out of them afterwards.
    again : bool
        Whether the states are first reset to where the previous levels began.
    """

    kernel: str
    text: str
    count: int
    levels: int
    most: int
    alone: bool
    begins: bool = True
    ends: bool = True
    again: bool = False

    @property
    def first(self) -> int | None:
        """The phase that comes first."""
        if self.again:
            return 4
        return 0 if self.begins else None

    def within(self, levels: str | None) -> str:
        """Return the statement that does all of it within another kernel, for one frame.

        Parameters
        ----------
        levels : str or None
            The levels that the frame takes, where it says how many.
        """
        first = -1 if self.first is None else self.first
        return f"{self.kernel}_alone(mine, {first}, {levels or self.count}, {self.ends:d});"

    def pieces(self, batch: int, units: int) -> int:
        """Return into how many strips each array of a batch is parted on a number of cores."""
        if self.alone and batch >= units:
            return 1
        return max(1, min(self.most, 2 * units // batch))

    def launches(self, pieces: int) -> int:
        """Return the launches for an array in a number of strips."""
        copies = (self.first is not None) + self.ends
        if pieces == 1 and self.alone:
            return copies + (self.count > 0)
        return copies + 2 * math.ceil(self.count / self.levels)


@dataclass(frozen=True, slots=True)
class Launch:
    """A kernel with `pieces` work items per frame."""

    kernel: str
    pieces: int


@dataclass(frozen=True, slots=True)
class Steps:
    """Steps, strip by strip, of the frames whose register `guard` is not 0 (None: all).

    Where frames say how many levels they take, the register `levels` of each does.
    """

    strips: Strips
    guard: int | None
    levels: int | None = None


@dataclass(frozen=True, slots=True)
class Rounds:
    """The steps that the host repeats.

    Attributes
    ----------
    parts : tuple of LaunchStep
    count : int or None
        How often, or None if the frames say it.
    bound : (int, int) or None
        The register of the number to count up to, of the frame with the largest, and from where.
    flag : int or None
        The register that is 0 once a frame needs no further round; asked before every round.
    """

    parts: "tuple[LaunchStep, ...]"
    count: int | None = None
    bound: tuple[int, int] | None = None
    flag: int | None = None


LaunchStep = Launch | Steps | Rounds


@dataclass(frozen=True, slots=True)
class LaunchPlan:
    """The steps of the host for a batch.

    Attributes
    ----------
    parts : tuple of LaunchStep
    registers, partials : int
        Numbers per frame that are kept in registers, and in partial sums.
    """

    parts: tuple[LaunchStep, ...]
    registers: int
    partials: int

    def launches(self, units: int) -> int:
        """Return the launches per frame on a number of cores.

        An iteration that frames end counts once; levels that depend on the frame all count.
        """
        return sum(_launches(part, units) for part in self.parts)


def _launches(part: LaunchStep, units: int) -> int:
    if isinstance(part, Launch):
        return 1
    if isinstance(part, Steps):
        return part.strips.launches(part.strips.pieces(1, units))
    return (part.count or 1) * sum(_launches(inner, units) for inner in part.parts)
