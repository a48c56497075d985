"""From frames of a simulated array to the scans of some protocol."""

from collections.abc import Sequence

import numpy as np

from cnnum.arrays import Floats
from cnnum.drivers.codecs.wire import Form
from cnnum.frame import Frame

LIKE = {"flux_x": "shear_x", "flux_y": "shear_y", "flux_z": "normal"}
"""Channels that follow a load as another one does."""

WARM = 25.0
"""°C of a sensor that measures its temperature."""


class Fitting:
    """Takes the taxels nearest to those of a form, and loads to the range of its numbers.

    Parameters
    ----------
    form : Form
    frames : sequence of Frame
        Of the whole run: the largest number of each channel becomes the form's strong load.
    """

    def __init__(self, form: Form, frames: Sequence[Frame]) -> None:
        self._form = form
        known, (rows, cols) = frames[0], form.shape
        names = [LIKE.get(name, name) for name in form.channels]
        self._channels = [known.channels.index(n) if n in known.channels else None for n in names]
        self._rows = np.arange(rows) * known.shape[0] // rows
        self._cols = np.arange(cols) * known.shape[1] // cols
        rest = np.median(np.stack([frame.values for frame in frames[:16]]), axis=0)
        self._rest = rest
        away = [np.abs(frame.values - rest).max(axis=(0, 1)) for frame in frames]
        self._largest = np.maximum(np.max(away, axis=0), 1e-30)

    def __call__(self, frame: Frame) -> Floats:
        """Return (rows, cols, channels) numbers of the form."""
        form = self._form
        loads = (frame.values - self._rest) / self._largest
        near = loads[self._rows][:, self._cols]
        values = np.full((*form.shape, len(form.channels)), form.rest)
        for at, (name, source) in enumerate(zip(form.channels, self._channels, strict=True)):
            if name == "temperature":
                values[..., at] = WARM
            elif source is not None:
                load = near[..., source]
                signed = name != "normal" or form.rest > 0
                values[..., at] += (form.full - form.rest) * (load if signed else np.abs(load))
        return values
