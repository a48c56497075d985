"""A second mechanics of touch: bodies on a brush of bristles, each with Coulomb's friction.

A bristle presses back in proportion to how far the body indents it (Winkler), bends with the body's
motion, and slips where its bend exceeds friction times its pressure. A taxel reads the bristles
around it by a bell, as through a cover. Nothing here is shared with the simulated array: neither
the pressures, nor the friction, nor the cover.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.simulated.grips import Arrays, Trial

PITCH, TAXELS, FINE = 1.5e-3, 8, 4
"""m between taxels, taxels to a side, bristles to a pitch."""

STIFFNESS = 1.5
"""Of a bristle against a push, over that against a bend: that of rubber, (2 − ν)/(2 − 2ν)."""

TOUCHED = 0.05
"""Share of the largest load from which a slip counts: the last of a contact always slips."""

SECONDS = 6.45
"""s of a scene at most."""

REST, SETTLED = 0.5, 0.45
"""s without contact at the start, and s at the start in which no report counts."""

STUCK, LOOSE, TURNS = 0.25, 0.5, 0.5
"""Shares of the load on bristles that stick: up to the first one a body slides as a whole, as a
face that slides meets fresh bristles in front; below the second it may be reported. Least share of
the motion that turns, of a pivot."""


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """A body's motion over a pad, frame by frame.

    Attributes
    ----------
    depth : (frames,) float, m
        Of its lowest point in the brush; below 0 it is in the air.
    x, y : (frames,) float, m
        How far it has been moved along the skin.
    angle : (frames,) float, rad
        How far it has been turned.
    tilt : (frames, 2) float, rad
        Its slope along x and y: it rocks.
    """

    depth: Floats
    x: Floats
    y: Floats
    angle: Floats
    tilt: Floats

    @classmethod
    def of(cls, depth: Floats, **moved: Floats) -> "Way":
        """Return a way that leaves out what does not move."""
        zero = np.zeros(len(depth))
        parts = dict.fromkeys(("x", "y", "angle"), zero)
        return cls(depth, **{**parts, "tilt": np.zeros((len(depth), 2)), **moved})

    def until(self, end: int) -> "Way":
        """Return its first frames."""
        return Way(*(part[:end] for part in (self.depth, self.x, self.y, self.angle, self.tilt)))


@dataclass(frozen=True, slots=True, eq=False)
class Brush:
    """A drawn body on a brush.

    Attributes
    ----------
    rng : numpy.random.Generator
    rate : float, Hz
    friction : float
    radius : float, m
        Of the sphere; of a flat disc its own, with `flat`.
    flat : bool
    start : (2,) float, m
        Where it touches, from the middle.
    depth : float, m
        Of a whole touch.
    direction : float, rad
    speed : float, m/s
    blur : float, m
        Width of the bell by which a taxel reads.
    noise : float
        Of a reading, over the largest one of a whole touch.
    """

    rng: np.random.Generator
    rate: float
    friction: float
    radius: float
    flat: bool
    start: Floats
    depth: float
    direction: float
    speed: float
    blur: float
    noise: float = 0.003

    @classmethod
    def drawn(cls, family: str, seed: int) -> "Brush":
        """Return the body of a family's scene; the same seed gives the same one."""
        rng = np.random.default_rng([seed, 2, *family.encode()])
        flat = bool(rng.random() < 0.5)
        size = rng.uniform(1.6e-3, 3.2e-3)
        depth = float(rng.uniform(0.1e-3, 0.25e-3))
        return cls(
            rng=rng,
            rate=float(rng.choice([60.0, 100.0, 200.0, 500.0])),
            friction=float(rng.uniform(0.3, 1.0)),
            radius=float(size if flat else size**2 / (2.0 * depth)),
            flat=flat,
            start=rng.uniform(-0.8e-3, 0.8e-3, 2),
            depth=depth,
            direction=float(rng.uniform(-np.pi, np.pi)),
            speed=float(0.5e-3 * 8.0 ** rng.random()),
            blur=float(rng.uniform(0.5, 0.9)) * PITCH,
        )

    def scans(self, seconds: float) -> int:
        """Return the frames in a time, at least one."""
        return max(1, round(seconds * self.rate))

    def place_of(self, arm: float) -> Floats:
        """Return the place (m, from the middle of the pad) about which `swung` turns a body."""
        aside = np.array([-np.sin(self.direction), np.cos(self.direction)])
        return np.asarray(self.start + arm * self.contact * aside)

    @property
    def contact(self) -> float:
        """Radius of a whole touch, m."""
        return self.radius if self.flat else (2.0 * self.radius * self.depth) ** 0.5

    def bends(self, share: float) -> float:
        """Return how far a body is moved on a whole touch for that share of friction's limit."""
        return share * self.friction * STIFFNESS * self.depth

    def pressed(self, depth: float, at: Floats, tilt: Floats, x: Floats, y: Floats) -> Floats:
        """Return the pressure on the bristles, in units of their stiffness."""
        away = (x - at[0]) ** 2 + (y - at[1]) ** 2
        shape = np.where(away < self.radius**2, 0.0, np.inf) if self.flat else away / (
            2.0 * self.radius)  # fmt: skip
        leans = tilt[0] * (x - at[0]) + tilt[1] * (y - at[1])
        pressed: Floats = np.maximum(depth - shape + leans, 0.0) * (depth > 0.0)
        return pressed


Moves = Callable[[Brush], Way]


def _along(brush: Brush, way: Floats) -> dict[str, Floats]:
    return {"x": way * np.cos(brush.direction), "y": way * np.sin(brush.direction)}


def _ramp(brush: Brush, seconds: float, begin: float, end: float) -> Floats:
    count = brush.scans(seconds)
    return np.asarray(begin + (end - begin) * np.arange(1, count + 1) / count)


def _touch(brush: Brush, *later: Floats) -> Floats:
    """Return the depth of nothing, a press and a hold, and what comes then."""
    air = np.full(brush.scans(REST), -1e-6)
    hold = np.full(brush.scans(0.4), brush.depth)
    return np.concatenate([air, _ramp(brush, 0.4, 0.0, brush.depth), hold, *later])


def slide(brush: Brush) -> Way:
    """Return a pull at an even speed, and a slide of 0.6 to 1.2 mm."""
    far = brush.bends(1.0) + brush.rng.uniform(0.6e-3, 1.2e-3)
    pull = _ramp(brush, far / brush.speed, 0.0, far)
    depth = _touch(brush, np.full(len(pull), brush.depth))
    return Way.of(depth, **_along(brush, np.concatenate([np.zeros(len(depth) - len(pull)), pull])))


def rocking(brush: Brush) -> Way:
    """Return a slide whose speed, load and slope swing at 1 to 4 Hz."""
    way = slide(replace(brush, speed=min(brush.speed, 1.5e-3)))
    time = np.arange(len(way.depth)) / brush.rate - REST - 0.8
    turn = 2.0 * np.pi * brush.rng.uniform(1.0, 4.0) * np.maximum(time, 0.0)
    swing = brush.rng.uniform(0.1, 0.25)
    size = (
        0.5
        * brush.depth
        / (brush.radius if brush.flat else (2 * brush.radius * brush.depth) ** 0.5)
    )
    tilt = (
        size * np.sin(turn)[:, None] * np.array([np.cos(brush.direction), np.sin(brush.direction)])
    )
    sway = 0.1e-3 * np.sin(turn)
    return replace(
        way,
        depth=np.where(way.depth > 0.0, way.depth * (1.0 + swing * np.sin(turn)), way.depth),
        x=way.x + sway * np.cos(brush.direction),
        y=way.y + sway * np.sin(brush.direction),
        tilt=tilt,
    )


def pivot(brush: Brush) -> Way:
    """Return a turn of 0.15 to 0.5 rad about the middle of the contact."""
    angle = brush.rng.choice([-1.0, 1.0]) * brush.rng.uniform(0.15, 0.5)
    turn = _ramp(brush, abs(angle) / brush.rng.uniform(0.3, 1.5), 0.0, angle)
    depth = _touch(brush, np.full(len(turn), brush.depth))
    return Way.of(depth, angle=np.concatenate([np.zeros(len(depth) - len(turn)), turn]))


def swung(arm: float) -> Moves:
    """Return a turn by 0.6 to 1.2 mm about a place at that distance from the middle, in radii.

    The middle first moves along the body's direction; the place lies on its right-hand side, or on
    its left where the sign of the arm is negative.
    """

    def moves(brush: Brush) -> Way:
        long, sense = abs(arm) * brush.contact, float(np.sign(arm))
        widest = max(long, 0.5 * brush.contact)
        far = brush.bends(1.0) + brush.rng.uniform(0.6e-3, 1.2e-3)
        angle = sense * min(far / widest, 1.2)
        turn = _ramp(brush, abs(angle) * widest / brush.speed, 0.0, angle)
        depth = _touch(brush, np.full(len(turn), brush.depth))
        turned = np.concatenate([np.zeros(len(depth) - len(turn)), turn])
        x, y = brush.place_of(arm) - brush.start
        return Way.of(
            depth,
            x=x - (np.cos(turned) * x - np.sin(turned) * y),
            y=y - (np.sin(turned) * x + np.cos(turned) * y),
            angle=turned,
        )

    return moves


def slid_then_turned(brush: Brush) -> Way:
    """Return a slide, 0.4 s of rest, and a turn of 0.25 to 0.5 rad in place."""
    way = slide(brush)
    angle = brush.rng.choice([-1.0, 1.0]) * brush.rng.uniform(0.25, 0.5)
    turn = _ramp(brush, abs(angle) / brush.rng.uniform(0.3, 1.5), 0.0, angle)
    waits = brush.scans(0.4)
    depth, x, y = (
        np.pad(v, (0, waits + len(turn)), mode="edge") for v in (way.depth, way.x, way.y)
    )
    return Way.of(depth, x=x, y=y, angle=np.concatenate([np.zeros(len(way.depth) + waits), turn]))


def oblique(frequency: float) -> Moves:
    """Return touches that come and go with their shear, 0.2 to 0.7 of friction's limit."""

    def moves(brush: Brush) -> Way:
        depth, way = [np.full(brush.scans(REST), -1e-6)], [np.zeros(brush.scans(REST))]
        lasts = 1.0 / frequency
        while sum(map(len, depth)) < 6.0 * brush.rate:
            share, high = brush.rng.uniform(0.2, 0.7), brush.depth * brush.rng.uniform(0.7, 1.2)
            rises = _ramp(brush, 0.3 * lasts, 0.0, 1.0)
            holds, air = np.ones(brush.scans(0.2 * lasts)), np.zeros(brush.scans(0.2 * lasts))
            touch = np.concatenate([rises, holds, rises[::-1], air])
            depth.append(np.where(touch > 0.0, high * touch, -1e-6))
            way.append(share * brush.friction * STIFFNESS * high * touch)
        return Way.of(np.concatenate(depth), **_along(brush, np.concatenate(way)))

    return moves


def part_pulled(brush: Brush) -> Way:
    """Return pulls to 0.3 to 0.7 of friction's limit and back, again and again."""
    way = [np.zeros(brush.scans(REST + 0.8))]
    while sum(map(len, way)) < 6.0 * brush.rate:
        far = brush.bends(brush.rng.uniform(0.3, 0.7))
        there = _ramp(brush, far / brush.speed, 0.0, far)
        way += [there, np.full(brush.scans(0.4), far), there[::-1], np.zeros(brush.scans(0.2))]
    path = np.concatenate(way)
    start = _touch(brush)
    return Way.of(np.concatenate([start, np.full(len(path) - len(start), brush.depth)]),
                  **_along(brush, path))  # fmt: skip


def swaying(brush: Brush) -> Way:
    """Return a body that rocks at 0.5 to 2 Hz, and sticks, under a part of its pull."""
    way = part_pulled(brush)
    time = np.maximum(np.arange(len(way.depth)) / brush.rate - REST - 0.8, 0.0)
    size = (
        0.3
        * brush.depth
        / (brush.radius if brush.flat else (2 * brush.radius * brush.depth) ** 0.5)
    )
    turn = np.sin(2.0 * np.pi * brush.rng.uniform(0.5, 2.0) * time)
    return replace(way, tilt=size * turn[:, None] * brush.rng.choice([-1.0, 1.0], 2) / 2**0.5)


def _bent(brush: Brush, way: Way, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return pressure and bends, frame by frame, and the shares of the load that stick."""
    frames = len(way.depth)
    pressed, bends = np.empty((frames, *x.shape)), np.empty((frames, *x.shape, 2))
    stuck, loads = np.ones(frames), np.zeros(frames)
    bend = np.zeros((*x.shape, 2))
    last = np.array([way.x[0], way.y[0], way.angle[0]])
    for n in range(frames):
        now = np.array([way.x[n], way.y[n], way.angle[n]])
        at = brush.start + now[:2]
        press = brush.pressed(float(way.depth[n]), at, way.tilt[n], x, y)
        step, last = now - last, now
        bend[..., 0] += step[0] - step[2] * (y - at[1])
        bend[..., 1] += step[1] + step[2] * (x - at[0])
        size, limit = np.hypot(bend[..., 0], bend[..., 1]), brush.friction * STIFFNESS * press
        keeps = np.minimum(1.0, limit / np.maximum(size, 1e-15))
        bend = bend * keeps[..., None]
        pressed[n], bends[n], loads[n] = press, bend / STIFFNESS, press.sum()
        stuck[n] = (press * (keeps >= 1.0)).sum() / max(loads[n], 1e-15)
    return pressed, bends, stuck, loads


def _read(brush: Brush, pressed: Floats, bends: Floats) -> Floats:
    """Return what taxels read, (frames, rows, cols, 3), pushes below 0 as of strain."""
    fine = (np.arange(TAXELS * FINE) + 0.5) / FINE
    taxels = np.arange(TAXELS) + 0.5
    bell = np.exp(-0.5 * ((fine - taxels[:, None]) * PITCH / brush.blur) ** 2)
    maps = np.concatenate([bends, pressed[..., None]], axis=-1)
    seen = -np.einsum("ra,nabk,cb->nrck", bell, maps, bell, optimize=True)
    return np.asarray(seen)


def scene(
    moves: Moves, *, pads: int = 1, other: Callable[[Brush], Brush] = lambda brush: brush
) -> Callable[[Arrays, str, int], Trial]:
    """Return scenes of a motion; with two pads the second one holds still under its pull.

    `other` makes another body of the one that is drawn.
    """

    def make(_: Arrays, family: str, seed: int) -> Trial:
        brush = other(Brush.drawn(family, seed))
        way = moves(brush).until(brush.scans(SECONDS - SETTLED))
        fine = ((np.arange(TAXELS * FINE) + 0.5) / FINE - TAXELS / 2) * PITCH
        x, y = np.meshgrid(fine, fine)
        pressed, bends, stuck, loads = _bent(brush, way, x, y)
        seen: Floats = _read(brush, pressed, bends)
        top = np.abs(seen).max()
        frames, spin = len(seen), np.gradient(way.angle)
        if pads == 2:
            still = replace(
                way,
                **{
                    k: np.minimum(np.hypot(way.x, way.y), brush.bends(0.4))
                    * getattr(np, f)(brush.direction)
                    for k, f in (("x", "cos"), ("y", "sin"))
                },
            )
            seen = np.concatenate([seen, _read(brush, *_bent(brush, still, x, y)[:2])], axis=2)
        seen = seen + brush.noise * top * brush.rng.standard_normal(seen.shape)
        seen = seen + top * brush.rng.uniform(-0.3, 0.3, seen.shape[1:])
        moved = np.hypot(np.diff(way.x, prepend=way.x[0]), np.diff(way.y, prepend=way.y[0]))
        turned = np.abs(spin) * 1.5e-3
        turns = (stuck < LOOSE) & (turned > TURNS * (moved + turned)) & (loads > 0.0)
        sliding = (stuck < STUCK) & (moved > turned) & (loads > TOUCHED * loads.max())
        held = loads > TOUCHED * loads.max()
        return Trial(
            family=family, name=f"{family} {seed}", rate=brush.rate,
            frames=seen.astype(np.float32),
            slips=np.where(sliding, 1.0, np.where((stuck < LOOSE) & held & ~turns, np.nan, 0.0)),
            scored=np.arange(frames) >= SETTLED * brush.rate,
            early=(stuck < LOOSE) & held, slid=np.cumsum(moved * sliding),
            sense=(np.sign(spin) * turns).astype(np.int64),
            direction=brush.direction if sliding.any() else float("nan"),
            rows=np.arange(frames),
            setting={"rate": brush.rate, **({"pads": 2} if pads == 2 else {})},
        )  # fmt: skip

    return make
