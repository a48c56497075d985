"""What the host does to run a plan for large arrays: launches, steps by strips, and rounds."""

from dataclasses import dataclass

from cnnum.engines.opencl.strips import Strips


@dataclass(frozen=True, slots=True)
class Launch:
    """A kernel of `pieces` work items a frame."""

    kernel: str
    pieces: int


@dataclass(frozen=True, slots=True)
class Steps:
    """Euler's steps, strip by strip, of the frames whose register `guard` is not 0 (None: all)."""

    strips: Strips
    guard: int | None


@dataclass(frozen=True, slots=True)
class Rounds:
    """What the host repeats.

    Attributes
    ----------
    parts : tuple of Part
    count : int or None
        How often; None where the frames say it.
    bound : (int, int) or None
        The register of the number to count up to, of the frame with the largest, and from where.
    flag : int or None
        The register that is 0 once a frame needs no further round; asked before every round.
    """

    parts: "tuple[Part, ...]"
    count: int | None = None
    bound: tuple[int, int] | None = None
    flag: int | None = None


Part = Launch | Steps | Rounds


@dataclass(frozen=True, slots=True)
class Parts:
    """What the host does for a batch.

    Attributes
    ----------
    parts : tuple of Part
    text : str
        All kernels.
    registers, partials : int
        Numbers a frame that are kept in registers, and for sums that are not yet complete.
    """

    parts: tuple[Part, ...]
    text: str
    registers: int
    partials: int

    def launches(self, units: int) -> int:
        """Return the launches a frame on so many cores; of rounds that frames end, one round."""
        return sum(_launches(part, units) for part in self.parts)


def _launches(part: Part, units: int) -> int:
    if isinstance(part, Launch):
        return 1
    if isinstance(part, Steps):
        return part.strips.launches(part.strips.pieces(1, units))
    return (part.count or 1) * sum(_launches(inner, units) for inner in part.parts)
