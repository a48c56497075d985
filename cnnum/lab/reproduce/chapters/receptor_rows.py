"""Table 2.I: the channels of the mechanoreceptors against closed forms of their own.

What a cell answers to a sine, the shape of its receptive field, and when it sends an impulse follow
from the table's numbers alone. The program's templates have no part in them.
"""

from collections.abc import Mapping
from functools import cache, partial
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.special import ive

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.lab.reproduce.faults import misled, scaled
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.programs.library import get_program
from cnnum.tactile.receptors import response
from cnnum.templates.tactile.shared.rest import Clock, corner, over_field

RATE, REST = 2000.0, 8
"""Frames a second, and frames of rest."""

HERTZ = np.array([5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0, 100.0, 200.0, 400.0])
"""One taxel each: whole periods in 0.2 s."""

CORNERS = MappingProxyType({"sa1": (15.0,), "ra1": (20.0, 50.0), "pc": (60.0, 60.0, 400.0),
                            "sa2_x": (15.0,)})  # fmt: skip
"""Hz of each high-pass, and of the low-pass at the end."""

FIELDS = MappingProxyType({"sa1": 2.0 / 1.5, "ra1": 2.5 / 1.5, "pc": 5.3, "sa2_x": 3.7})
"""Widths at half height in pitches of 1.5 mm: Ø 2 and 2.5 mm are the table's."""

POINTS: Mapping[str, float] = MappingProxyType(
    dict[str, float].fromkeys(("sa1_field", "ra1_field", "pc_field", "sa2_field"), 0.0)
)

SIDE = 13
"""Taxels across, for the fields."""

LADDER = np.arange(0.9, 1.1001, 0.002)
"""Amplitudes of a vibration, over the least that sends an impulse a period."""

MEMBRANE, SILENT, BUZZ = 1e-3, 1e-3, 50.0
"""Time constant of a leaky cell and its silence after an impulse, s, and the vibration, Hz."""


def _felt(
    frames: Floats, outputs: list[str], settings: Mapping[str, float], engine: str = "numba"
) -> dict[str, Floats]:
    """Return outputs of `receptors` for (frames, rows, columns, 3) signals."""
    program = get_program("receptors").bind(
        **{"rate": RATE, "rest": REST / RATE, "push": 1.0, **settings}
    )
    precision = "float64" if engine == "numba" else None
    plan = Engine(engine, precision=precision).compile(program, frames.shape[1:3], outputs)
    stream = plan.stream()
    results = [stream.push(frame) for frame in frames]
    return {name: np.array([result[name] for result in results]) for name in outputs}


def _time() -> Floats:
    """Return the times of 0.4 s of frames after the rest, s."""
    return np.asarray((np.arange(round(0.4 * RATE) + REST) - REST) / RATE, dtype=np.float64)


def sampled(hertz: Floats, corners: tuple[float, ...]) -> NDArray[np.complex128]:
    """Return a channel's response to a sine that runs straight between frames.

    Straight lines between samples make images of the sine around each multiple of the rate, by
    sinc²; at the frames they add to it.
    """
    slow, quick = 0.5 / np.pi / corners[0], 0.5 / np.pi / corners[-1]
    images = hertz + RATE * np.arange(-1000, 1001)[:, np.newaxis]
    through = response(images, stages=len(corners) - 1, slow=slow, quick=quick)
    return np.asarray(np.sum(np.sinc(images / RATE) ** 2 * through, axis=0))


@cache
def _gains() -> dict[str, NDArray[np.complex128]]:
    """Return gain and phase of each channel at `HERTZ`, of the last 0.2 s."""
    time = _time()
    frames = np.zeros((time.size, 1, HERTZ.size, 3))
    wave = np.sin(2.0 * np.pi * HERTZ * np.maximum(time[:, np.newaxis], 0.0))
    frames[..., 0, :, 0] = frames[..., 0, :, 2] = wave
    last = slice(-round(0.2 * RATE), None)
    turned = np.exp(-2j * np.pi * HERTZ * time[last, np.newaxis])
    felt = _felt(frames, list(CORNERS), POINTS)
    return {name: 2j * np.mean(v[last, 0] * turned, axis=0) for name, v in felt.items()}


def gain_gap(channel: str) -> float:
    """Return the largest error of a channel's gain and phase, as a complex number."""
    return float(np.abs(_gains()[channel] - sampled(HERTZ, CORNERS[channel])).max())


def bell(width: float) -> Floats:
    """Return the (13, 13) share of a point in the middle that each taxel of a lattice gets.

    Diffusion over the time t along a line without end gives e^(−2t) I_n(2t), and both axes
    diffuse alone. What would leave the array turns back at its rim: it is mirrored there.
    """
    time, middle, n = width**2 / (16.0 * np.log(2.0)), SIDE // 2, np.arange(SIDE)
    turns = 2 * SIDE * np.arange(-3, 4)[:, np.newaxis]
    orders = np.stack([n - middle + turns, n + middle + 1 + turns])
    line = np.asarray(ive(orders, 2.0 * time), dtype=np.float64).sum(axis=(0, 1))
    return np.asarray(line[:, np.newaxis] * line)


@cache
def _fields() -> dict[str, Floats]:
    """Return what each channel makes of a point in the middle of an array, over its sum."""
    frames = np.zeros((REST + 2, SIDE, SIDE, 3))
    frames[REST:, SIDE // 2, SIDE // 2] = 1.0
    felt = _felt(frames, [*FIELDS], {}, "reference")
    return {name: v[-1] / v[-1].sum() for name, v in felt.items()}


def field_gap(channel: str) -> float:
    """Return how far a receptive field is from the bell of its width, as a share of the peak."""
    exact = bell(FIELDS[channel])
    return float(np.abs(_fields()[channel] - exact).max() / exact.max())


def least_amplitude() -> float:
    """Return the least amplitude of a vibration that sends an impulse at every peak.

    Over the closed form's: the cell follows the mean of two outputs for the time of a frame. What
    an impulse takes from its charge has faded long before the next peak, by exp(−9).
    """
    step, turn = 1.0 / RATE, 2j * np.pi * BUZZ / RATE
    keeps = np.exp(-step / MEMBRANE)
    charge = sampled(np.array([BUZZ]), CORNERS["pc"])[0]
    charge *= 0.5 * (1.0 + np.exp(-turn)) * (1.0 - keeps) / (1.0 - keeps * np.exp(-turn))
    buzz: NDArray[np.complex128] = charge * np.exp(turn * np.arange(round(RATE / BUZZ)))
    peak = float(buzz.imag.max())
    time = _time()
    frames = np.zeros((time.size, 1, LADDER.size, 3))
    wave = np.sin(2.0 * np.pi * BUZZ * np.maximum(time, 0.0))
    frames[..., 0, :, 2] = wave[:, np.newaxis] * LADDER
    cell = {**POINTS, "threshold": peak, "membrane": MEMBRANE, "refractory": SILENT}
    impulses = _felt(frames, ["pc_spikes"], cell)["pc_spikes"]
    each = np.maximum(impulses[-round(0.2 * RATE) :, 0], 0.0).sum(axis=0) / (0.2 * BUZZ)
    return float(LADDER[np.argmax(each > 0.99)])


NAMES = MappingProxyType({"sa1": "SA-I", "ra1": "RA-I", "pc": "PC", "sa2_x": "SA-II"})
SHAKEN = "frames at 2 kHz; what the start leaves has faded to 1e-8"

CHAPTER = Chapter(
    "Chapter 2 — the channels of the mechanoreceptors",
    (
        *(
            Item(f"table-2.I-{name}",
                 f"gain and phase of {name}, 5 to 400 Hz, against closed form", "Table 2.I", 0.0,
                 partial(gain_gap, channel), 1e-6, SHAKEN,
                 faults=(misled(corner, 0, "Hz", factor=1.01), scaled(Clock.behind, 1.01)))
            for channel, name in NAMES.items()
        ),
        *(
            Item(f"table-2.I-{name}-field", f"receptive field of {name} against a bell", source,
                 0.0, partial(field_gap, channel), 1e-6, "exact diffusion on the lattice: rounding",
                 "of the peak", faults=(misled(over_field, 1, "width", factor=1.01),))
            for channel, name, source in (
                ("sa1", "SA-I", "Table 2.I: Ø 2 mm"),
                ("ra1", "RA-I", "Table 2.I: Ø 2.5 mm"),
                ("pc", "PC", "Table 2.I; ten times the area of RA-I"),
                ("sa2_x", "SA-II", "Table 2.I; five times the area of RA-I"),
            )
        ),
        Item("table-2.I-impulses", "least vibration that sends an impulse of PC at every peak",
             "Table 2.I", 1.0, least_amplitude, 0.003,
             "one step of the amplitudes, 0.002", "of the closed form's",
             faults=(scaled(Clock.behind, 1.01), misled(corner, 0, "Hz", factor=1.01))),
    ),
    {},
)  # fmt: skip
