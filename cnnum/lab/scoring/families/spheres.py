"""Scenes with a sphere: pulled, twisted, or held; contact and truth by the simulated array."""

from collections.abc import Callable, Iterator, Sequence
from math import cos, sin

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.array import SimulatedArray
from cnnum.drivers.simulated.motion import Command, commands
from cnnum.drivers.simulated.springs import State
from cnnum.frame import Truth
from cnnum.lab.scoring.families.arrays import Arrays, strain_of, touch
from cnnum.lab.scoring.families.bounds import LOOSE_TORQUE
from cnnum.lab.scoring.families.draw import Array, Draw
from cnnum.lab.scoring.families.pulls import Pull, Pulling
from cnnum.lab.scoring.families.taxel_effects import Skin
from cnnum.lab.scoring.trial import Trial
from cnnum.report.record import truth_columns

Make = Callable[[Arrays, str, int], Trial]
"""From the name of a family and a seed to its scene."""

TWIST_RATE, TWIST_TIME = (0.1, 1.0), 2.5
"""rad/s, and s at most."""

SETTLED = 0.45
"""s at the start in which nothing counts: programs take their rest there."""

PLAIN, WHOLE = Array(), Skin()


def pulled(pulling: Pulling, array: Array = PLAIN, skin: Skin = WHOLE) -> Make:
    """Return scenes in which a sphere is pressed on and pulled."""

    def make(arrays: Arrays, family: str, seed: int) -> Trial:
        draw = Draw.of(family, seed, array)
        pull = pulling(draw, draw.bounds.travel())
        return played(arrays, draw, array, skin, family, list(_pulls(draw, pull)))

    return make


def twisted(array: Array = PLAIN, skin: Skin = WHOLE) -> Make:
    """Return scenes in which a sphere is pressed on and turned until it slips in circles."""

    def make(arrays: Arrays, family: str, seed: int) -> Trial:
        draw = Draw.of(family, seed, array)
        angle = draw.bounds.turn(LOOSE_TORQUE) * draw.uniform(1.4, 2.5)
        frames = draw.scans(min(angle / draw.log(*TWIST_RATE), TWIST_TIME))
        turn = draw.sign() * angle / frames
        hand = [Command(load=draw.bounds.load, turn=turn)] * frames
        return played(arrays, draw, array, skin, family, hand)

    return make


def played(
    arrays: Arrays,
    draw: Draw,
    array: Array,
    skin: Skin,
    family: str,
    hand: Sequence[Command],
) -> Trial:
    """Return a touch, and the hand's movement after it, as a trial."""
    made = arrays.made(draw, array)
    before = commands(touch(draw), draw.rate)
    return trial_of(made, draw, skin, family, list(made.follow([*before, *hand])))


def trial_of(
    array: SimulatedArray,
    draw: Draw,
    skin: Skin,
    family: str,
    moments: Sequence[tuple[State, Truth]],
) -> Trial:
    """Return contacts with their truth as a trial."""
    strain = strain_of(array, [state for state, _ in moments])
    truth = truth_columns([truth for _, truth in moments])
    slips, count = truth["slip"], len(moments)
    steps = np.array([float(np.hypot(*state.slipped)) for state, _ in moments])
    turns = np.sign(truth["twist_rate"]) * truth["twist_slip"]
    first = int(np.argmax(slips > 0))
    return Trial(
        family=family,
        name=f"{family} {draw.seed}",
        rate=draw.rate,
        frames=skin.read(array, strain, draw.rng).astype(np.float32),
        slips=slips,
        scored=np.arange(count) >= SETTLED * draw.rate,
        early=truth["incipient"] > 0,
        slid=np.cumsum(steps * (slips > 0)),
        sense=turns.astype(np.int64),
        direction=float(truth["slip_direction"][first]) if slips.any() else float("nan"),
        rows=np.arange(count),
        setting={"rate": draw.rate},
    )


def _pulls(draw: Draw, pull: Pull) -> Iterator[Command]:
    along = (cos(draw.direction), sin(draw.direction))
    moves: Floats = np.diff(pull.way, prepend=0.0)
    for move, load, friction in zip(moves, pull.load, pull.friction, strict=True):
        yield Command(
            load=draw.bounds.load * float(load),
            move=(float(move) * along[0], float(move) * along[1]),
            friction=float(friction),
        )
