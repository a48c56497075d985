"""Table 2.I: the bands of the mechanoreceptors, and one impulse at every peak of a vibration."""

from functools import partial
from types import MappingProxyType

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.lab.reproduce.faults import misled, scaled
from cnnum.lab.reproduce.record import Chapter, Item
from cnnum.programs.fields import log
from cnnum.programs.library import get_program
from cnnum.tactile.receptors import response
from cnnum.templates.tactile.shared.rest import corner

RATE, REST = 4000.0, 8
"""Frames a second, far above the bands, and frames of rest."""

HERTZ = np.array([10.0, 15.0, 20.0, 25.0, 31.6, 40.0, 50.0, 60.0, 100.0, 150.0, 200.0, 400.0])
"""One taxel each."""

POINTS = MappingProxyType(dict.fromkeys(("sa1_field", "ra1_field", "pc_field", "sa2_field"), 0.0))


def _felt(output: str, time: Floats, hertz: Floats, **settings: float) -> Floats:
    """Return an output of `receptors` under sines of these frequencies, (frames, frequencies)."""
    given = {"rate": RATE, "rest": REST / RATE, "push": 1.0, **POINTS, **settings}
    program = get_program("receptors").bind(**given)
    plan = Engine("numba", precision="float64").compile(program, (1, hertz.size), [output])
    frames = np.zeros((time.size, 1, hertz.size, 3))
    frames[..., 0, :, 2] = np.sin(2.0 * np.pi * hertz * np.maximum(time[:, None], 0.0))
    stream = plan.stream()
    return np.array([stream.push(frame)[output][0] for frame in frames])


def _gains(channel: str) -> Floats:
    """Return the gain of a channel at `HERTZ`: of the last 0.2 s, whole periods but for 31.6 Hz."""
    time = (np.arange(round(0.3 * RATE) + REST) - REST) / RATE
    result = _felt(channel, time, HERTZ)[-round(0.2 * RATE) :]
    turned = np.exp(-2j * np.pi * HERTZ * time[-len(result) :, None])
    return np.asarray(2.0 * np.abs(np.mean(result * turned, axis=0)))


def sa1_at_its_corner() -> float:
    """Return the gain of SA-I at 15 Hz, the end of its band."""
    return float(_gains("sa1")[HERTZ == 15.0][0])


def best_of(channel: str) -> float:
    """Return the frequency at which a channel's gain is largest, Hz."""
    return float(HERTZ[np.argmax(_gains(channel))])


def spikes_a_period() -> float:
    """Return the impulses of PC a period of 200 Hz, of an amplitude a half above the least one."""
    time = (np.arange(round(0.3 * RATE) + REST) - REST) / RATE
    hertz, membrane = 200.0, 1e-3
    own = abs(
        complex(response(hertz, stages=2, slow=0.5 / np.pi / 60.0, quick=0.5 / np.pi / 400.0))
    )
    # the least threshold that a leaky cell never meets under a sine of this size
    least = own / np.hypot(1.0, 2.0 * np.pi * hertz * membrane)
    result = _felt("pc_spikes", time, np.array([hertz]), threshold=least / 1.5, membrane=membrane)
    return float(np.maximum(result[-round(0.2 * RATE) :], 0.0).sum() / (0.2 * hertz))


CHAPTER = Chapter(
    "Chapter 2 — the channels of the mechanoreceptors",
    (
        Item("table-2.I-SA-I", "gain of SA-I where its band ends, at 15 Hz", "Table 2.I",
             float(np.sqrt(0.5)), sa1_at_its_corner, 2e-3,
             "the corner of a low-pass; frames at 4 kHz, and the rest of the start", "",
             faults=(misled(corner, 0, "Hz", factor=1.05),)),
        *(
            Item(f"table-2.I-{name}", f"frequency that {name} feels best", "Table 2.I", band,
                 partial(best_of, channel), 0.0,
                 "a dozen frequencies are tried; the best lies within the printed band", "Hz",
                 "within", faults=(misled(corner, 0, "Hz", factor=away),))
            for name, channel, band, away in (
                ("RA-I", "ra1", (20.0, 50.0), 3.0),
                ("PC", "pc", (60.0, 400.0), 0.1),
            )
        ),
        Item("table-2.I-impulses", "impulses of PC a period of a vibration", "Table 2.I", 1.0,
             spikes_a_period, 0.0,
             "one at every peak, exactly, of an amplitude 1.5 times the least", "",
             faults=(scaled(log, 0.1), misled(corner, 0, "Hz", factor=5.0))),
    ),
    {},
)  # fmt: skip
