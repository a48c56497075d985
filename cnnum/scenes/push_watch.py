"""Notices a parameter `push` that is the wrong way round: pushes that read as pulls."""

import inspect
import logging
from collections.abc import Sequence

import numpy as np

from cnnum.arrays import Floats
from cnnum.programs import Program
from cnnum.programs.machine import REST

EVERY = 4
"""One frame in this number is looked at."""

ENOUGH = 8
"""Looks in a row that must agree."""

CLEAR = 20.0
"""Peak of a pull over the noise at rest: a touch, and no drift."""

OUTWEIGHS = 2.0
"""Peak of the pulls over that of the pushes. Around a push under a cover, strain is a pull of 0.2
times its peak. Around a pull along the skin, it is a pull of as much as the push."""

HELD = ("slip", "twist", "mindlin_slip", "grasp_code")
"""Programs that may begin with a held object: its release reads as a pull rightly."""


class PushWatch:
    """Looks at some frames of a scene, and says once that `push` seems wrong.

    Parameters
    ----------
    program : Program
        With its parameters.
    channels : sequence of str
        The channels of the frames; nothing is done unless the normal load is among them.
    """

    __slots__ = ("_agreed", "_channel", "_count", "_name", "_push", "_rest", "_square", "said")

    def __init__(self, program: Program, channels: Sequence[str]) -> None:
        known = inspect.signature(program.function).parameters
        able = "push" in known and "normal" in channels and program.name not in HELD
        self._channel = channels.index("normal") if able else None
        self._name = program.name
        default = known["push"].default if able else 1.0
        value = dict(program.parameters).get("push", default)
        self._push = float(value) if isinstance(value, int | float) else 1.0
        self._rest: Floats | float = 0.0
        self._square: Floats | float = 0.0
        self.said = False
        self.begin()

    def begin(self) -> None:
        """Begin anew with the next frame; a message that was said is not said again."""
        self._count = self._agreed = 0
        self._rest = self._square = 0.0

    def look(self, values: Floats) -> None:
        """Take in the (rows, cols, channels) values of a good frame."""
        if self._channel is None or self.said:
            return
        self._count += 1
        if self._count > REST and self._count % EVERY:
            return
        normal = values[..., self._channel]
        if self._count <= REST:
            self._rest = self._rest + normal / REST
            self._square = self._square + normal**2 / REST
            return
        noise = float(np.sqrt(np.maximum(self._square - np.square(self._rest), 0.0)).mean())
        loads = self._push * (normal - self._rest)
        push, pull = float(loads.max()), -float(loads.min())
        size = float(np.abs(self._rest).max())
        wrong = pull > CLEAR * max(noise, 1e-6 * size) and pull > OUTWEIGHS * max(push, 0.0)
        self._agreed = self._agreed + 1 if wrong else 0
        if self._agreed >= ENOUGH:
            self.said = True
            logging.getLogger("cnnum").warning("%s", self.sentence())

    def sentence(self) -> str:
        """Return the message."""
        return (
            f"The normal load of the array falls where it is touched, as a pull: the parameter "
            f"'push' of program '{self._name}' is {self._push:g} and seems the wrong way round; "
            f"set program.parameters.push={-self._push:g} if these are pushes."
        )
