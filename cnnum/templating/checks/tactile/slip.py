"""What `slip`, `twist` and `tactile` are checked against: Cattaneo and Mindlin's pull, Lubkin's
turn.
"""

import math

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.program_records import Outputs, ProgramCase, ProgramForm
from cnnum.templating.checks.tactile.sphere_streams import (
    BEGIN,
    DEPTH,
    Place,
    Sphere,
    pulled,
    turned,
)

RATE = 200.0
"""Frames a second."""

HALF = 0.75
"""Share of its time at which half the contact radius sticks in a pull: c/a = √(1 − x)."""

STOPS = 0.4
"""Share of its time at which one of the pulls stops; c is 0.77 a, and the force 0.54 μP."""

NOISE = 1e-4
"""Of a reading, as a share of the stream's largest: a 25th of a real array's. Without any, a change
of one taxel that only comes from the surface's cells is no noise, and is taken for a broken one."""

NEVER = math.nan


def _sphere(rng: np.random.Generator, shape: Shape) -> Sphere:
    """Draw a sphere whose contact stays on the array, and is wider than two pitches."""
    radius = float(rng.uniform(0.16, 0.2)) * max(min(shape), 7)
    x, y = rng.uniform(-0.3, 0.3, 2)
    return Sphere(radius, float(rng.uniform(0.4, 0.8)), (float(x), float(y)))


def _noisy(streams: list[Floats], rng: np.random.Generator) -> Floats:
    """Return streams side by side, (frames, streams, rows, cols, 3)."""
    frames = np.stack(streams, axis=1)
    largest = np.max(np.abs(frames), axis=(0, 2, 3, 4), keepdims=True)
    return np.asarray(frames + NOISE * largest * rng.normal(size=frames.shape))


def _frame(time: float) -> float:
    """Return the first frame that is not before a time since `BEGIN` − 1."""
    return BEGIN + math.ceil(time) - 1.0


def _pulls(rng: np.random.Generator, shape: Shape, count: int, frames: int) -> ProgramCase:
    """Draw pulls that end in gross slip 20 frames before the end or earlier, and one that stops."""
    streams = list[Floats]()
    angles, soon, gross = list[float](), list[float](), list[float]()
    for number in range(count + 1):
        time, angle = float(rng.uniform(30, frames - 20)), float(rng.uniform(-np.pi, np.pi))
        stops = number == count
        share = STOPS if stops else math.inf
        streams.append(pulled(shape, _sphere(rng, shape), time, angle, frames, share))
        angles.append(angle)
        soon.append(NEVER if stops else _frame(HALF * time))
        gross.append(NEVER if stops else _frame(time))
    expected = {
        "incipient_slip": np.array(soon),
        "gross_slip": np.array(gross),
        "angle": np.array(angles),
    }
    return ProgramCase(_noisy(streams, rng), expected)


def _turns(rng: np.random.Generator, shape: Shape, count: int, frames: int) -> ProgramCase:
    """Draw turns, half of either sense, that go on for 20 frames or more after c = a/2."""
    streams, rates, found = list[Floats](), list[float](), list[float]()
    centres = list[Place]()
    for number in range(count):
        time, sense = float(rng.uniform(25, frames - 20)), 1 - 2 * (number % 2)
        sphere = _sphere(rng, shape)
        streams.append(turned(shape, sphere, time, sense, frames))
        rates.append(sense * sphere.turn(0.5) / time * RATE)
        centres.append(sphere.centre)
        found.append(_frame(time))
    middle = (np.array(shape) - 1.0) / 2.0
    expected = {
        "twist": np.array(found),
        "rate": np.array(rates),
        "column": np.array(centres)[:, 0] + middle[1],
        "row": np.array(centres)[:, 1] + middle[0],
    }
    return ProgramCase(_noisy(streams, rng), expected, {"depth": DEPTH, "rate": RATE})


def _slip_case(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    return _pulls(rng, shape, 3, 80)


def _twist_case(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    return _turns(rng, shape, 3, 80)


def _tactile_case(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Draw two pulls, one that stops, and two turns; a pull is no twist, nor a twist a slip."""
    pulls, turns = _pulls(rng, shape, 2, 70), _turns(rng, shape, 2, 70)
    never_slips, never_turns = np.full(2, NEVER), np.full(3, NEVER)
    expected = {
        name: np.concatenate([pulls.expected[name], never_slips])
        for name in ("incipient_slip", "gross_slip")
    }
    expected["twist"] = np.concatenate([never_turns, turns.expected["twist"]])
    frames = np.concatenate([pulls.frames, turns.frames], axis=1)
    return ProgramCase(frames, expected, turns.parameters)


def _frames_off(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest distance of a report from its frame; infinite for one too few or many."""
    worst = 0.0
    flags = [name for name in ("incipient_slip", "gross_slip", "twist") if name in outputs]
    for name in flags:
        for flag, frame in zip(outputs[name].T, case.expected[name], strict=True):
            found = _onsets(flag)
            if len(found) != (0 if np.isnan(frame) else 1):
                return np.inf
            worst = max([worst, *(abs(at - float(frame)) for at in found)])
    return worst


def _onsets(flag: Floats) -> list[int]:
    held = np.concatenate([[False], np.asarray(flag) > 0])
    return [int(frame) for frame in np.flatnonzero(held[1:] & ~held[:-1])]


def _direction_off(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest angle between slip and pull from a gross report on; π without one."""
    angle = np.arctan2(outputs["slip_y"], outputs["slip_x"]) - case.expected["angle"]
    off = np.abs((angle + np.pi) % (2 * np.pi) - np.pi)
    slips = np.asarray(outputs["gross_slip"]) > 0
    slides = ~np.isnan(case.expected["gross_slip"])
    if not slips[-1][slides].all():
        return np.pi
    return float(off[slips].max())


def _rate_off(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest error of a rate, with its sense, from the report on, as a share."""
    off = np.abs(np.asarray(outputs["twist_rate"]) / case.expected["rate"] - 1.0)
    return _worst_while_turning(off, outputs)


def _centre_off(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest distance of a centre from the sphere's, cells, from the report on."""
    away = np.hypot(
        outputs["twist_row"] - case.expected["row"],
        outputs["twist_column"] - case.expected["column"],
    )
    return _worst_while_turning(away, outputs)


def _worst_while_turning(off: Floats, outputs: Outputs) -> float:
    turns = np.asarray(outputs["twist"]) > 0
    return float(off[turns].max()) if turns[-1].all() else np.inf


BELIEF = "beliefs reach their level up to 3 frames off, in 40 draws of 4×4 and 8×8 taxels"

FORMS = (
    ProgramForm(
        "incipient-onset", "slip", ("incipient_slip",), _slip_case, _frames_off, 4, BELIEF,
        "frames from c = a/2 in pulls at a constant speed, by Cattaneo and Mindlin",
        compares="all",
    ),
    ProgramForm(
        "gross-onset", "slip", ("gross_slip",), _slip_case, _frames_off, 3,
        "it shows a frame after, and is weighed against a pull that stops: up to 2 frames",
        "frames from c = 0 in pulls at a constant speed, by Cattaneo and Mindlin",
        compares="all",
    ),
    ProgramForm(
        "pull-direction", "slip", ("gross_slip", "slip_x", "slip_y"), _slip_case, _direction_off,
        0.06, "taxels sample the strain around a contact coarsely: up to 0.045",
        "angle between the slip reported and the pull, rad",
        compares="all",
    ),
    ProgramForm(
        "turn-onset", "twist", ("twist",), _twist_case, _frames_off, 2,
        "it shows a frame after: up to 1 frame",
        "frames from c = a/2 in turns at a constant rate, by Lubkin",
        compares="all",
    ),
    ProgramForm(
        "turn-rate", "twist", ("twist", "twist_rate"), _twist_case, _rate_off, 0.07,
        "it goes with the cube of a radius that few taxels tell: up to 0.05",
        "error of a turn's rate, with its sense, as a share",
        compares="all",
    ),
    ProgramForm(
        "turn-centre", "twist", ("twist", "twist_row", "twist_column"), _twist_case, _centre_off,
        0.15, "what lies below a tenth of the peak is cut off, cell by cell: up to 0.13",
        "distance from the middle of a sphere's contact, cells",
        compares="all",
    ),
    ProgramForm(
        "slip-and-turn-onset", "tactile", ("incipient_slip", "gross_slip", "twist"),
        _tactile_case, _frames_off, 4, BELIEF,
        "frames from c = a/2 and c = 0; a pull is no twist, and a turn no slip",
        compares="all",
    ),
)  # fmt: skip
