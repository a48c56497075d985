"""The parts of a program's check: frames of known answer, and the error of outputs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from cnnum.arrays import Floats, Shape

Outputs = Mapping[str, Floats]


@dataclass(frozen=True, slots=True, eq=False)
class ProgramCase:
    """Frames that a program is run on, and the right answer.

    Attributes
    ----------
    frames : (frames, [batch,] rows, cols, channels) float
        One stream, or several side by side.
    expected : mapping
        The reference of the form's `error`.
    parameters : mapping
        Keyword parameters of the program.
    """

    frames: Floats
    expected: Outputs
    parameters: Mapping[str, object] = field(default_factory=dict[str, object])

    @property
    def batch(self) -> tuple[int, ...]:
        """Leading axes of one frame."""
        return self.frames.shape[1:-3]


@dataclass(frozen=True, slots=True)
class ProgramForm:
    """A closed form that a tactile program is checked against.

    Attributes
    ----------
    name : str
        Name of the closed form.
    program : str
        Program of the program in the library.
    needs : tuple of str
        Outputs that are compared.
    cases : callable
        (random generator, (rows, cols)) to a case.
    error : callable
        (case, outputs of the last frame, or of all) to the largest error.
    tolerance : float
    tolerance_reason : str
        Why it is not smaller.
    summary : str
        Description of the answer.
    too_slow : tuple of str
        Engines that take longer than a minute, and are left out.
    left_out : str
        Why.
    compares : "last" or "all"
        The last frame's outputs, or those of all frames, with the frames as the first axis.
    """

    name: str
    program: str
    needs: tuple[str, ...]
    cases: Callable[[np.random.Generator, Shape], ProgramCase]
    error: Callable[[ProgramCase, Outputs], float]
    tolerance: float
    tolerance_reason: str
    summary: str
    too_slow: tuple[str, ...] = ()
    left_out: str = ""
    compares: Literal["last", "all"] = "last"
