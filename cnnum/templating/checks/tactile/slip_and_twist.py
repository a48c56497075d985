"""Slip and twist against an independent computation in plain NumPy.

Slip and twist by the motion in a contact, frame by frame in NumPy and double precision.

The oracle of the programs `slip` and `twist`: it knows no templates, no graph and no engine.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_propagation

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.program_run import Outputs, ProgramCase, ProgramForm

FAST, SPREAD, HOLD = 0.02, 4.0, 0.5
"""Smoothing, s; diffusion time, cells²; share of a level below which a report ends."""

LOOSE, STIRS, TOUCHED, STICKS, ALIGNED, DIVERGING = 0.25, 0.05, 0.1, 0.5, 0.3, 0.2
PIVOTS, CENTRED, PULLED, HIDDEN, LASTS = 0.1, 0.5, 2.0, 3.0, 0.2
"""As in the programs."""


@dataclass(frozen=True, slots=True)
class Constants:
    """Parameters of the programs under the same names; times in s, rates in 1/s.

    `most_load_rate` is `still` of `twist`; `false_reports` leads to `level` and `turn`.
    """

    push: float = -1.0
    shear_gain: float = 1.0
    axes: bool = True
    pads: int = 1
    rate: float = 200.0
    rest: float = 0.4
    look: float = 0.08
    load: float = 0.35
    floor: float = 240.0
    still: float = 0.2
    pull: float = 0.6
    swing: float = 0.6
    level: float = 0.40
    turn: float = 0.1
    most_load_rate: float = 0.25
    hold_time: float = 0.1

    @property
    def quiet(self) -> int:
        """Frames of rest."""
        return max(4, int(np.ceil(np.round(self.rest * self.rate, 6))))

    def step(self, time: float) -> float:
        """Return the share of a change that a leaky mean takes in a frame."""
        return float(-np.expm1(-1.0 / (self.rate * time)))


def central(values: Floats, axis: int) -> Floats:
    """Return half the difference of the two neighbours, a cell beyond the rim as on it."""
    wide = np.pad(values, 1, mode="edge")
    if axis == 1:
        return (wide[1:-1, 2:] - wide[1:-1, :-2]) / 2.0
    return (wide[2:, 1:-1] - wide[:-2, 1:-1]) / 2.0


def diffused(values: Floats, time: float) -> Floats:
    """Return a map after diffusion on the lattice without flux through the rim, by its modes."""
    for axis, cells in enumerate(values.shape):
        places: Floats = np.arange(cells, dtype=np.float64)
        modes: Floats = np.cos(np.pi * np.outer(places, places + 0.5) / cells)
        modes = modes * np.sqrt(np.where(places > 0.0, 2.0, 1.0) / cells)[:, None]
        decay = np.exp(-time * (2.0 - 2.0 * np.cos(np.pi * places / cells)))
        spread: Floats = (modes.T * decay) @ modes
        values = spread @ values if axis == 0 else values @ spread.T
    return values


@dataclass(slots=True)
class Latch:
    """A flag: on above a level, off when below a share of it for longer than a time."""

    level: float
    frames: float
    on: bool = False
    low: int = 0

    def step(self, value: float) -> bool:
        """Return the flag after a value."""
        self.low = 0 if value > HOLD * self.level else self.low + 1
        self.on = value > self.level or (self.on and self.low <= self.frames)
        return self.on


@dataclass(slots=True)
class MovingContact:
    """The memories from frame to frame, one frame per call."""

    c: Constants
    slips: Latch
    turns: Latch
    frames: list[Floats] = field(default_factory=list[Floats])
    maps: dict[str, Floats] = field(default_factory=dict[str, Floats])
    rest: Floats = field(default_factory=lambda: np.zeros(1))
    noise: float = 0.0
    trends: Floats = field(default_factory=lambda: np.zeros(1))
    largest: Floats = field(default_factory=lambda: np.zeros(1))
    swings: Floats = field(default_factory=lambda: np.zeros(1))
    masses: Floats = field(default_factory=lambda: np.zeros(1))
    offsets: Floats = field(default_factory=lambda: np.zeros(1))
    opened: Floats = field(default_factory=lambda: np.zeros(1))
    beyond: int = 0
    calm: int = 0
    doubt: bool = False
    hidden: bool = False
    loose: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(1, dtype=bool))

    def step(self, frame: Floats) -> dict[str, float]:
        """Return the outputs of a frame (rows, cols, 3): shear x, shear y, normal."""
        c, resting = self.c, len(self.frames) < self.c.quiet
        if resting:
            self.frames.append(frame)
            self._learn()
        above = c.push * (frame - self.rest)
        now = {"z": np.maximum(above[..., 2], 0.0)}
        now |= {"x": c.shear_gain * above[..., 0], "y": c.shear_gain * above[..., 1]}
        for name, value in now.items():
            held = self.maps.get(name, 0.0 * value)
            now[name] = self.maps[name] = held + c.step(FAST) * (value - held)
        old = {name: self.maps.get(f"old {name}", 0.0 * value) for name, value in now.items()}
        for name, value in now.items():
            self.maps[f"old {name}"] = old[name] + c.step(c.look) * (value - old[name])
        pads = self._read(now, old)
        if resting:
            self.masses = np.array([pad["mass"] for pad in pads])
            self.trends = self.largest = self.swings = 0.0 * self.masses
            self.offsets = np.array([pad["curl"] for pad in pads])
            self.opened = np.array([pad["divergence"] for pad in pads])
            return dict.fromkeys(OUTPUTS, 0.0)
        return self._decided(now, pads)

    def _learn(self) -> None:
        normal = np.stack(self.frames)[..., 2]
        # without each reading's two extremes, once there are three
        held = np.sort(self.frames, axis=0)
        self.rest = held[1:-1].mean(axis=0) if len(held) > 2 else self.frames[0]
        if len(self.frames) > 1:
            self.noise = float(np.sqrt((np.diff(normal, axis=0) ** 2).mean() / 2.0))
        self.noise = max(self.noise, 1e-6 * float(np.abs(normal.mean(axis=0)).max()))

    def _read(self, now: dict[str, Floats], old: dict[str, Floats]) -> list[dict[str, float]]:
        """Return the numbers of each pad."""
        c = self.c
        per_s = c.rate * c.step(c.look)
        change = {axis: per_s * (now[axis] - old[axis]) for axis in "xy"}
        around = {axis: diffused(change[axis], SPREAD) for axis in "xy"}
        loose = {axis: change[axis] - around[axis] for axis in "xy"}
        stick = self._stick_region(now["z"], loose, around)
        curl = central(now["y"], 1) - central(now["x"], 0)
        divergence = central(now["x"], 1) + central(now["y"], 0)
        wide = now["z"].shape[1] // c.pads
        result: list[dict[str, float]] = []
        for pad in range(c.pads):
            cols = slice(pad * wide, (pad + 1) * wide)
            # gradients next to another pad would mix both
            inner = slice(pad * wide + (pad > 0), (pad + 1) * wide - (pad < c.pads - 1))
            z, before, x, y = (m[:, cols] for m in (now["z"], old["z"], now["x"], now["y"]))
            was_x, was_y = (old[axis][:, cols].sum() for axis in "xy")
            least = max(c.floor * self.noise * np.sqrt(z.size), 1e-12)
            mass, size = z.sum() + least, np.sqrt((z**2).sum() + least**2 / z.size)
            share, was = now["z"] / mass, old["z"] / (before.sum() + least)
            moved = np.linalg.norm((share - was)[:, cols])
            force = np.hypot(x.sum(), y.sum())
            right, down = (central((share + was) / 2.0, axis)[:, inner] for axis in (1, 0))
            slope = (x.sum() * right + y.sum() * down) / max(force, 1e-300)
            steep = np.sqrt((right**2 + down**2).sum())
            pulled = (x.sum() * x + y.sum() * y) / max(force, 1e-300)
            lengths = np.linalg.norm(z) * np.linalg.norm(pulled)
            heavy = (z**2).sum() + least**2 / (16.0 * z.size)
            place: dict[str, Floats] = {
                axis: np.asarray(np.indices(z.shape)[n], dtype=np.float64)
                for n, axis in enumerate(("down", "right"))
            }
            middle = {
                axis: float((z**2 * at).sum() / max((z**2).sum(), 1e-30))
                for axis, at in place.items()
            }
            down, aside = (place[axis] - middle[axis] for axis in ("down", "right"))
            size2 = (z * (down**2 + aside**2)).sum() / mass + 1e-12
            torque = (aside * y - down * x).sum() / mass
            # for friction k (row0 - row, col - col0) z: force k (row0 - row), torque k size2
            # no place is farther away than 4 sizes
            k = torque / size2
            k = np.copysign(max(abs(k), force / mass / (4.0 * np.sqrt(size2)), 1e-300), k)
            along = -((share - was)[:, inner] * slope).sum() / max(moved * steep, 1e-300)
            result.append({
                "pattern_speed": per_s * moved * mass / size,
                "incoherent_shear": np.sqrt(
                    sum((loose[a][:, cols] ** 2).sum() for a in "xy")
                ) / size,
                "ratio": force / mass,
                "ratio_rate": per_s * np.hypot(
                    x.sum() / mass - was_x / (before.sum() + least),
                    y.sum() / mass - was_y / (before.sum() + least),
                ),
                "stick_share": z[stick[:, cols]].sum() / mass,
                "alignment": (z * pulled).sum() / max(lengths, 1e-300),
                "mass": mass,
                "torque": torque / np.sqrt(size2),
                "row": middle["down"] + x.sum() / mass / k,
                "column": wide * pad + middle["right"] - y.sum() / mass / k,
                "beyond": force - HIDDEN * z.sum() - least / 12.0,
                "counts": z.sum() - least,
                "read": max(force, z.sum()) - least / 48.0,
                "load_rate": per_s * (z.sum() - before.sum()),
                "motion_cosine": along,
                "x": x.sum(),
                "y": y.sum(),
                "curl": (now["z"] * curl)[:, inner].sum() / heavy,
                "divergence": (now["z"] * divergence)[:, inner].sum() / heavy,
            })  # fmt: skip
        return result

    def _stick_region(
        self, z: Floats, rests: dict[str, Floats], around: dict[str, Floats]
    ) -> NDArray[np.bool_]:
        """Return the cells that stick: loose ones grow over all that change half as clearly."""
        contact = z > TOUCHED * z.max()
        change, held = (np.abs(shears["x"]) + np.abs(shears["y"]) for shears in (rests, around))
        least = LOOSE * held + STIRS * z
        may = contact & (change > least / 2.0)
        begins = may & ((change > least) | self.loose)
        self.loose = binary_propagation(begins, np.ones((3, 3), dtype=bool), may)
        return np.asarray(contact & ~self.loose)

    def _strength(self, pad: dict[str, float], ratio: float, explained: float) -> float:
        c, moves = self.c, np.cbrt(pad["pattern_speed"] ** 2 * pad["incoherent_shear"])
        strength = moves * ratio / (c.still + explained)
        strength *= pad["stick_share"] < STICKS
        if c.axes:
            strength *= (0.75 * max(0.0, 1.0 + pad["motion_cosine"])) ** 2
            strength *= min(max(pad["alignment"], 0.0) / ALIGNED, 1.0)
        return float(strength)

    def _decided(self, now: dict[str, Floats], pads: list[dict[str, float]]) -> dict[str, float]:
        c = self.c
        mean = {name: float(np.mean([pad[name] for pad in pads])) for name in pads[0]}
        load_rate = abs(mean["load_rate"]) / mean["mass"]
        masses = np.array([pad["mass"] for pad in pads])
        in_a_frame = abs(float((masses - self.masses).mean()))
        load_rate = min(load_rate, c.rate * in_a_frame / mean["mass"])
        self.trends += c.step(c.load) * (c.rate * (masses - self.masses) / masses - self.trends)
        self.masses = masses
        self.largest = np.maximum(np.abs(self.trends), (1.0 - c.step(c.load)) * self.largest)
        rates = np.array([abs(pad["load_rate"]) for pad in pads]) / masses
        self.swings = np.maximum(rates, (1.0 - c.step(c.load)) * self.swings)
        ratio = max(pad["ratio"] for pad in pads)
        pulls = np.array([pad["ratio_rate"] for pad in pads])
        explained = float(
            (self.largest + c.swing * rates + c.look * self.swings**2 + c.pull * pulls).mean()
        )
        strengths = [self._strength(pad, ratio, explained) for pad in pads]
        strength, most = max(strengths), pads[int(np.argmax(strengths))]
        curls, parts = (np.array([pad[n] for pad in pads]) for n in ("curl", "divergence"))
        if load_rate > c.most_load_rate:
            self.offsets, self.opened = curls, parts
        where = int(np.argmax(np.abs(curls - self.offsets)))
        turned, apart = float((curls - self.offsets)[where]), float((parts - self.opened)[where])
        slips = self.slips.step(strength)
        above = {name: max(pad[name] for pad in pads) for name in ("beyond", "counts", "read")}
        sound = above["beyond"] <= 0.0 and (above["counts"] > 0.0 or above["read"] < 0.0)
        self.beyond = self.beyond + 1 if above["beyond"] > 0.0 else 0
        self.hidden = self.hidden or self.beyond >= LASTS * c.rate
        self.calm = self.calm + 1 if sound else 0
        self.doubt = self.beyond > 0 or (self.doubt and self.calm < LASTS * c.rate)
        silent = self.hidden or self.doubt
        pulled = np.inf if silent else PULLED * pads[where]["ratio"] + DIVERGING * abs(apart)
        torque = float(np.mean([abs(pad["torque"]) for pad in pads]))
        turning = mean["pattern_speed"] * torque / np.hypot(torque, mean["ratio"])
        pivots = slips and turning > PIVOTS
        turns = self.turns.step(abs(turned) if abs(turned) > pulled else 0.0)
        force = max(float(np.hypot(most["x"], most["y"])), 1e-300)
        wide = now["z"].shape[1] // c.pads
        weight = 0.0 * now["z"]
        weight[:, where * wide : (where + 1) * wide] = now["z"][:, where * wide :][:, :wide] ** 2
        weight /= max(weight.sum(), 1e-300)
        row, column = (
            float(np.dot(weight.sum(axis=1 - axis), np.arange(cells, dtype=np.float64)))
            for axis, cells in enumerate(weight.shape)
        )
        values = (
            slips, most["x"] / force, most["y"] / force, float(strength), turns,
            float(np.sign(turned)) * turns, abs(turned), row, column,
            torque, turning, pivots, pivots * float(np.sign(most["torque"])),
            pivots and abs(most["torque"]) > CENTRED * ratio, most["row"], most["column"],
        )  # fmt: skip
        return dict(zip(OUTPUTS, map(float, values), strict=True))


OUTPUTS = (
    "gross_slip", "slip_x", "slip_y", "slip_strength",
    "twist", "twist_sense", "twist_strength", "twist_row", "twist_column",
    "slip_torque", "slip_turning", "slip_pivots", "slip_sense", "slip_centred", "slip_row",
    "slip_column",
)  # fmt: skip


def played(frames: Floats, c: Constants) -> dict[str, Floats]:
    """Return the outputs of a stream (frames, rows, cols, 3) by name, one number per frame."""
    frames_held = c.hold_time * c.rate + 1e-6
    contact = MovingContact(c, Latch(c.level, frames_held), Latch(c.turn, frames_held))
    steps = [contact.step(frame) for frame in frames]
    return {name: np.array([step[name] for step in steps]) for name in OUTPUTS}


SETTINGS = Constants(rate=100.0)

NOISE = 1e-4
"""RMS of a reading over the peak load of the patch."""

PRESS, PULL, GO = 45, 90, 110
"""Frames at which the patch is pressed, gets its shear, and moves on; rest is 40 frames."""

FRAMES = 135

SPEED = 0.03
"""Widths of the sliding patch by which it moves on in a frame."""

FLAGS = ("gross_slip", "twist", "twist_sense")

NUMBERS = ("slip_strength", "twist_strength")

DIRECTION, CENTRE = ("slip_x", "slip_y"), ("twist_row", "twist_column")

ROUNDED = 1e-5
"""Error of a number, and of a place in cells, in single precision: up to 2e-6 is seen."""


def _ramp(start: int, frames: int = 20) -> Floats:
    return np.asarray(np.clip((np.arange(FRAMES) - start + 1.0) / frames, 0.0, 1.0))


def patch(rng: np.random.Generator, shape: Shape, angle: float, sense: float) -> Floats:
    """Return a patch that is pressed and pulled, strain (frames, rows, cols, 3).

    With a `sense` it turns in place, else it slides along the angle, rad.
    """
    rows, cols = (np.arange(cells, dtype=float) - (cells - 1) / 2.0 for cells in shape)
    wide = min(shape) / 5.0
    gone = np.maximum(np.arange(FRAMES) - GO, 0.0) * SPEED * wide * (sense == 0.0)
    down = rows[:, None] - np.sin(angle) * gone[:, None, None]
    right = cols - np.cos(angle) * gone[:, None, None]
    load = np.exp(-(down**2 + right**2) / (2.0 * wide**2)) * _ramp(PRESS)[:, None, None]
    pull = (0.5 * _ramp(PULL))[:, None, None]
    x, y = np.cos(angle) + 0.0 * right, np.sin(angle) + 0.0 * down
    if sense:
        x, y = -sense * down / wide, sense * right / wide
    signals = np.stack([pull * x * load, pull * y * load, load], axis=-1)
    return np.asarray(SETTINGS.push * signals + NOISE * rng.normal(size=signals.shape))


def streams(rng: np.random.Generator, shape: Shape) -> Floats:
    """Return noise, a patch that slides, and two that turn, (frames, 4, rows, cols, 3)."""
    noise = NOISE * rng.normal(size=(FRAMES, *shape, 3))
    angle = float(rng.uniform(-np.pi, np.pi))
    turns = (patch(rng, shape, angle, sense) for sense in (0.0, 1.0, -1.0))
    return np.stack([noise, *turns], axis=1)


def _case(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    frames = streams(rng, shape)
    results = [played(frames[:, number], SETTINGS) for number in range(frames.shape[1])]
    expected = {name: np.stack([result[name] for result in results], axis=1) for name in OUTPUTS}
    return ProgramCase(frames, expected, {"rate": SETTINGS.rate})


def _two_pads(rng: np.random.Generator, shape: Shape) -> ProgramCase:
    """Return the sliding patch on one pad and noise on the other, in half the columns each."""
    rows, cols = shape
    frames = streams(rng, (rows, cols // 2))
    joined = np.concatenate([frames[:, 1], frames[:, 0]], axis=-2)
    settings = replace(SETTINGS, pads=2)
    return ProgramCase(joined, played(joined, settings), {"rate": SETTINGS.rate, "pads": 2})


def _numbers_off(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest error of a strength, as a share of it from 1 up."""
    return max(
        float((np.abs(outputs[n] - e) / np.maximum(1.0, np.abs(e))).max())
        for n, e in case.expected.items()
        if n in NUMBERS and n in outputs
    )


def _reports_off(case: ProgramCase, outputs: Outputs) -> float:
    """Return the largest error of a flag, and under a shear of a direction and a centre.

    Noise has neither, and a turn in place no direction.
    """

    def off(names: tuple[str, ...], begin: int, some: slice) -> float:
        errors = (outputs[n] - case.expected[n] for n in names if n in outputs)
        return max((float(np.abs(error)[begin:, some].max()) for error in errors), default=0.0)

    sheared = PULL + 5
    slides, pressed = slice(1, 2), slice(1, None)
    return max(
        off(FLAGS, 0, slice(None)), off(DIRECTION, sheared, slides), off(CENTRE, sheared, pressed)
    )


SUMS = "sums of a patch over noise of 1e-4, in single precision; flags are right or wrong"
DIFFERENCES = "differences of maps of loads that nearly agree, in single precision"

FORMS = (
    ProgramForm(
        "slip-strength", "slip", ("slip_strength",), _case, _numbers_off, ROUNDED, DIFFERENCES,
        "strength of noise, a patch that slides and two that turn, by the definition in NumPy",
        compares="all",
    ),
    ProgramForm(
        "slip-report", "slip", ("gross_slip", *DIRECTION), _case, _reports_off, ROUNDED, SUMS,
        "flags and directions of the same streams",
        compares="all",
    ),
    ProgramForm(
        "slip-pads", "slip", ("slip_strength",), _two_pads, _numbers_off, ROUNDED, DIFFERENCES,
        "strength of a patch that slides on one of two pads",
        compares="all",
    ),
    ProgramForm(
        "twist-strength", "twist", ("twist_strength",), _case, _numbers_off, ROUNDED, DIFFERENCES,
        "strength of noise, a patch that slides and two that turn, by the definition in NumPy",
        compares="all",
    ),
    ProgramForm(
        "twist-report", "twist", ("twist", "twist_sense", *CENTRE), _case, _reports_off, ROUNDED,
        SUMS,
        "flags, senses and centres of the same streams",
        compares="all",
    ),
    ProgramForm(
        "slip-and-twist", "tactile", (*FLAGS, *NUMBERS), _case, _reports_off, ROUNDED, SUMS,
        "flags of the same streams: a slide is no twist, and a turn no slip",
        compares="all",
    ),
)  # fmt: skip
