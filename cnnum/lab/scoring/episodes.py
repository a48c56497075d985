"""Episodes: the pulls and twists of a scene, and when the closed forms say that they slip.

They are read from the ground truth alone, not from the script, so that they are the same for a
scene file. A pull lasts while the shear force, a twist while the torque (over the contact radius),
exceeds a small share of the scene's largest normal load. What a hand that gave way leaves behind is
less: as such a contact is lifted it slips, too, but nobody needs to know.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cnnum.lab.scoring.play import Play
from cnnum.report.verdicts import held

LOADED = 0.03
"""Share of the normal load from which a sideways one is a pull or a twist: the least part of a pull
or twist that is generated has 0.05, and slip takes 0.3 at least."""


@dataclass(frozen=True, slots=True)
class Episode:
    """A pull or a twist.

    Attributes
    ----------
    kind : str
        "pull" or "twist".
    first, after : int
        Its first frame and the one after its last.
    loose : int or None
        First frame in which the stick radius is below half the contact radius.
    gross : int or None
        Of a pull: first frame of gross slip, c = 0.
    gross_after : int
        The frame after the last one of gross slip; 0 without.
    """

    kind: str
    first: int
    after: int
    loose: int | None
    gross: int | None
    gross_after: int

    def holds(self, frame: int, room: int = 0) -> bool:
        """Return whether a frame lies in it, or at most `room` frames beside it."""
        return self.first - room <= frame < self.after + room


def episodes_of(play: Play) -> tuple[Episode, ...]:
    """Return the pulls and twists of a scene, in order of time."""
    found = (*_pulls(play), *_twists(play))
    return tuple(sorted(found, key=lambda episode: episode.first))


def _pulls(play: Play) -> Iterator[Episode]:
    truth = play.truth
    force = np.hypot(truth["shear_x"], truth["shear_y"])
    least = LOADED * truth["normal_force"].max()
    slides = truth["slip"] > 0
    for first, after in held((force > least).astype(float)):
        loose = _first((truth["incipient"] > 0) | slides, first, after)
        gross = _first(slides, first, after)
        last = first + int(np.flatnonzero(slides[first:after])[-1]) + 1 if gross is not None else 0
        yield Episode("pull", first, after, loose, gross, last)


def _twists(play: Play) -> Iterator[Episode]:
    truth = play.truth
    least = LOADED * (truth["normal_force"] * truth["contact_radius"]).max()
    for first, after in held((np.abs(truth["torque"]) > least).astype(float)):
        yield Episode("twist", first, after, _first(truth["twist_slip"] > 0, first, after), None, 0)


def _first(flags: NDArray[np.bool_], first: int, after: int) -> int | None:
    place = np.flatnonzero(flags[first:after])
    return first + int(place[0]) if place.size else None
