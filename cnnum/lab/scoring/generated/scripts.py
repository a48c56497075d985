"""What the hand does in generated scenes: scenes that slip or twist, and scenes that do neither."""

from math import pi

from cnnum.drivers.simulated.script import Phase
from cnnum.lab.scoring.generated.bounds import LOOSE_TORQUE
from cnnum.lab.scoring.generated.case import Case
from cnnum.lab.scoring.generated.draw import Draw, Script

Phases = tuple[Phase, ...]

REST = 0.5
"""s without contact at the start: 30 frames at 60 Hz."""

SPEED = (0.3e-3, 3e-3)
"""m/s of a pull."""

TWIST_RATE = (0.1, 1.0)
"""rad/s."""

SLIDE = (0.1, 0.3, 1.0e-3)
"""s and s: how long gross slip lasts; m: how far it goes at most."""

LONGEST = 2.5
"""s that a twist lasts at most."""

HELD_FOR = 6.0
"""s of a scene in which nothing slips: a hundred of them are ten minutes."""


def slip_case(seed: int) -> Case:
    """Return a scene of the suite "slip": half of them pull, the rest pull and twist, twist only,
    or do either and stop before anything slips.
    """
    return Draw("slip", seed).case(_slip_script)


def held_case(seed: int) -> Case:
    """Return a scene of the suite "false-alarms": an object is held, gripped, rolled, shaken."""
    return Draw("false-alarms", seed).case(_held_script)


def _slip_script(draw: Draw) -> tuple[str, Phases]:
    kinds: tuple[tuple[str, Script], ...] = (
        ("pull", _pull),
        ("pull and twist", _pull_and_twist),
        ("twist", _twist),
        ("part", _part),
    )
    weights = (0.5, 0.25, 0.15, 0.1)
    which = int(draw.rng.choice(len(kinds), p=weights))
    kind, script = kinds[which]
    _, middle = script(draw)
    return kind, (*_touch(draw), *middle, *_leave())


def _touch(draw: Draw) -> Phases:
    return (
        Phase("hold", REST),
        Phase("press", draw.uniform(0.2, 0.5), load=draw.bounds.load),
        Phase("hold", draw.uniform(0.15, 0.4)),
    )


def _leave() -> Phases:
    return (Phase("release", 0.2), Phase("hold", 0.1))


def _pull(draw: Draw) -> tuple[str, Phases]:
    """Pull until it has slipped for a while, then give way."""
    speed = draw.log(*SPEED)
    slide = min(draw.uniform(*SLIDE[:2]), SLIDE[2] / speed)
    lasts = draw.bounds.travel() / speed + max(slide, 6.0 / draw.rate)
    pull = Phase("pull", lasts, speed=speed, direction=draw.angle())
    return "pull", (pull, Phase("relax", 0.3))


def _twist(draw: Draw) -> tuple[str, Phases]:
    """Turn well beyond the angle at which the stick radius is half the contact radius."""
    angle = draw.bounds.turn(LOOSE_TORQUE) * draw.uniform(1.4, 2.5)
    lasts = min(angle / draw.log(*TWIST_RATE), LONGEST)
    return "twist", (Phase("twist", lasts, angle=draw.sign() * angle), Phase("relax", 0.3))


def _pull_and_twist(draw: Draw) -> tuple[str, Phases]:
    return "pull and twist", (*_pull(draw)[1], Phase("hold", 0.3), *_twist(draw)[1])


def _part(draw: Draw) -> tuple[str, Phases]:
    """Pull, or turn, until 0.3 to 0.7 of what friction holds; the stick radius stays above a/2."""
    share = draw.uniform(0.3, 0.7)
    hold = (Phase("hold", 0.4), Phase("relax", 0.3))
    if draw.rng.random() < 0.5:
        speed = draw.log(*SPEED)
        lasts = draw.bounds.travel(share) / speed
        return "part", (Phase("pull", lasts, speed=speed, direction=draw.angle()), *hold)
    angle = draw.bounds.turn(share)
    lasts = angle / draw.log(*TWIST_RATE)
    return "part", (Phase("twist", lasts, angle=draw.sign() * angle), *hold)


def _held_script(draw: Draw) -> tuple[str, Phases]:
    phases = list(_touch(draw))
    if draw.rng.random() < 0.3:
        # a held object weighs: a share of what friction holds that a shaken grip still holds
        speed = draw.log(*SPEED)
        lasts = draw.bounds.travel(draw.uniform(0.1, 0.3)) / speed
        phases.append(Phase("pull", lasts, speed=speed, direction=draw.angle()))
    steps = (_grip, _roll, _vibrate, _hold, _touch_again)
    while True:
        step = steps[int(draw.rng.choice(len(steps), p=(0.35, 0.2, 0.2, 0.15, 0.1)))](draw)
        if _seconds([*phases, *step]) > HELD_FOR - 0.6:
            break
        phases += step
    phases.append(Phase("release", 0.3))
    return "held", (*phases, Phase("hold", HELD_FOR - _seconds(phases)))


def _seconds(phases: list[Phase]) -> float:
    return sum(phase.duration for phase in phases)


def _grip(draw: Draw) -> Phases:
    """Change the load to something between half and one and a third of the first one."""
    load = draw.bounds.load * draw.log(0.6, 1.35)
    return (Phase("grip", draw.log(0.15, 1.0), load=load), Phase("hold", 0.2))


def _roll(draw: Draw) -> Phases:
    """Roll to one side and back."""
    speed, direction = draw.log(*SPEED), draw.angle()
    lasts = min(draw.uniform(0.2, 0.8), 0.8e-3 / speed)
    there = Phase("roll", lasts, speed=speed, direction=direction)
    return (there, Phase("roll", lasts, speed=speed, direction=direction + pi))


def _vibrate(draw: Draw) -> Phases:
    frequency = draw.log(3.0, min(40.0, draw.rate / 4.0))
    cycles = max(1, round(draw.uniform(0.4, 1.0) * frequency))
    swing = draw.log(0.03, 0.3)
    return (Phase("vibrate", cycles / frequency, frequency=frequency, amplitude=swing),)


def _hold(draw: Draw) -> Phases:
    return (Phase("hold", draw.uniform(0.3, 1.0)),)


def _touch_again(draw: Draw) -> Phases:
    press = Phase("press", draw.uniform(0.15, 0.4), load=draw.bounds.load * draw.log(0.6, 1.35))
    return (Phase("release", 0.2), Phase("hold", 0.2), press, Phase("hold", 0.2))
