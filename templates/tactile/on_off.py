"""ON and OFF responses, sustained and transient, of a retina model to a load on the skin.

    receptors            follow the signal, coupled to their neighbours     on_off_layers, layer 2
    surround             follows the receptors, slower and wider            layer 3
    sustained            receptors − surround
    adaptation           follows the sustained answer                       layer 4
    transient            sustained − adaptation
    ON, OFF              what is above 0 of each, and below

A uniform load has no sustained response. A body gives an ON response inside its edge and an OFF
response around it.

References
----------
Bálya, Roska, Roska & Werblin, Int. J. Circuit Theory Appl. 30 (2002) 363: a multi-layer retina of
cellular networks; Werblin, Roska & Chua, same journal 23 (1995) 541.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import exp, pi

import numpy as np

from cnnum.programs import program
from cnnum.programs.fields import Field, maximum, square, where
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.reports import report
from cnnum.templates.tactile.shared.loads import PUSH
from cnnum.templates.tactile.shared.rest import Clock
from cnnum.templating.library import get_template

WINS = 1.2
"""Smallest ratio of a reported response to that of the other sign. A press has 1.3 or more; a load
that moves sideways has equal responses, and neither comes nor goes."""

ECHO, LASTS = 0.5, 2.0
"""Part of the largest answer of late below which an answer is its echo, and over how many times of
`adapting` that is forgotten: the echoes fade twice as fast."""


@program
def on_off(
    frame: FrameFields,
    *,
    push: float = PUSH,
    rest: float = 0.4,
    receptor: float = 0.01,
    surround: float = 0.03,
    adapting: float = 0.1,
    level: float = 10.0,
    hold_time: float = 0.05,
) -> Mapping[str, Field]:
    """Compute the four responses of centre and surround, and where a load comes and goes.

    Parameters
    ----------
    frame : FrameFields
        Only `normal` is read, in any unit.
    push, rest : float, none, s
        As for `motion_direction`.
    receptor, surround, adapting : float, s
        Time constants of the layers.
    level, hold_time : float, none, s
        An event begins when the largest transient response exceeds `level` times its noise at
        rest, is at least 1.2 times that of the other sign, and is not an echo of a larger one
        before. It ends once the response has been below half of that for `hold_time`.

    Returns
    -------
    mapping
        `on_sustained`, `off_sustained`, `on_transient`, `off_transient` (maps in the unit of
        `normal`, 0 or above), `on_strength`, `off_strength` (largest transient response over
        its noise; 0 if not reported), `on_row`, `on_column`, `off_row`, `off_column` (centroid of
        the squared transient response, cells), `comes`, `goes` (flags).

    Raises
    ------
    ProgramError
        If a parameter is out of range.
    """
    refuse_outside(
        receptor=(receptor, 1e-6, 1e6), surround=(surround, 1e-6, 1e6),
        adapting=(adapting, 1e-6, 1e6), level=(level, 1.0, 1e6), hold_time=(hold_time, 0.0, 1e6),
    )  # fmt: skip
    frame.sees(0.5 / pi / min(receptor, surround, adapting), "comes", "goes")
    clock = Clock(frame, rest)
    layers = get_template("on_off_layers")
    layers = replace(layers, tau=np.array([1.0, receptor, surround, adapting]))
    _, near, far, late = clock.layers_behind(layers, clock.above_rest("normal", push))
    sustained = near - far
    transient = sustained - late
    noise = clock.noise(square(transient).mean(), ("normal",))
    result = {
        f"{sign}_{name}": maximum(factor * answer, 0.0)
        for sign, factor in (("on", 1.0), ("off", -1.0))
        for name, answer in (("sustained", sustained), ("transient", transient))
    }
    peaks = {sign: result[f"{sign}_transient"].max() for sign in ("on", "off")}
    lately = frame.memory("largest answer of late", scalar=True)
    fades = exp(-1.0 / (frame.rate * LASTS * adapting))
    largest = maximum(fades * lately.value, maximum(peaks["on"], peaks["off"]))
    lately.store(where(clock.resting, 0.0, largest))
    for sign, other, flag in (("on", "off", "comes"), ("off", "on", "goes")):
        wins = ~clock.resting & (peaks[sign] > WINS * peaks[other])
        wins = wins & (peaks[sign] > ECHO * largest)
        strength = where(wins, peaks[sign] / noise, 0.0)
        row, column = frame.centroid(square(result[f"{sign}_transient"]))
        result |= {f"{sign}_strength": strength, f"{sign}_row": row, f"{sign}_column": column}
        result[flag] = report(frame, strength, level, hold_time * frame.rate)
    return result
