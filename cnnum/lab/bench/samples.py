"""Inputs of benchmarks: templates with all weights in use, and maps of a fixed seed."""

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.drivers.registry import open_driver
from cnnum.frame import Frame
from cnnum.graph.nodes import RunSpec
from cnnum.programs import Program, program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import transient
from cnnum.scenes.conversion import conversion_for
from cnnum.scenes.scene_file import read_scene
from cnnum.templating.template import Template

SEED = 7


def generator() -> np.random.Generator:
    """Return the generator that every benchmark begins with."""
    return np.random.default_rng(SEED)


def full_template(radius: int = 1, layers: int = 1, *, boundary: float | str = 0.0) -> Template:
    """Return a template whose weights are all different and none 0, so that none can be left out.

    Its row sums are below 1: the array contracts, and outputs stay within their linear range or
    not, as the frames have it.
    """
    k = 2 * radius + 1
    weights = generator().uniform(0.5, 1.0, (layers, layers, k, k))
    weights *= np.sign(generator().uniform(-1.0, 1.0, weights.shape))
    return Template(
        f"full {k}x{k}, {layers} layers",
        weights * (0.9 / np.abs(weights).sum(axis=(1, 2, 3)).max()),
        generator().uniform(0.1, 0.4, (layers, 1, 1, 1)),
        0.05,
        boundary=boundary,
        initial=0.0,
        duration=1.0,
    )


def even_template(radius: int = 1) -> Template:
    """Return a template whose weights depend on the distance alone, so that many are equal."""
    row, col = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    weights = np.exp(-(row**2 + col**2) / 3.0)
    return Template(
        f"even {2 * radius + 1}x{2 * radius + 1}",
        weights * (0.9 / weights.sum()),
        [[0.3]],
        0.05,
        boundary=0.0,
        initial=0.0,
        duration=1.0,
    )


def maps(*shape: int) -> Floats:
    """Return maps of numbers between −1 and 1."""
    return generator().uniform(-1.0, 1.0, shape)


def frames(batch: int, shape: Shape, channels: int = 3) -> NDArray[np.float32]:
    """Return a batch of frames as a driver would hand them on."""
    return maps(batch, *shape, channels).astype(np.float32)


TOUCHED = 82
"""First frame of `touch` with a contact: programs take up to 80 to learn the rest level."""


def touch(count: int = TOUCHED + 10, shape: Shape = (8, 8)) -> NDArray[np.float32]:
    """Return frames of a stream: noise, then a contact that is pushed and pulled."""
    rows, cols = shape
    row, col = np.mgrid[:rows, :cols]
    near = (row - 0.45 * rows) ** 2 + (col - 0.4 * cols) ** 2
    bump = np.exp(-near / (0.1 * rows * cols / 2))
    pushed = np.clip(np.arange(count) - TOUCHED + 1.0, 0.0, None)[:, np.newaxis, np.newaxis]
    rest = generator().normal(0.0, 2e-3, (count, rows, cols, 3))
    # compression is negative, and a pull along x shears towards −x
    rest[..., 0] -= 0.02 * np.clip(pushed - 3.0, 0.0, None) * bump
    rest[..., 2] -= 0.1 * np.minimum(pushed, 4.0) * bump
    return rest.astype(np.float32)


def scene_frames(scene: str) -> list[Frame]:
    """Return all frames of a scene that comes with the package, its calibration applied.

    Returns
    -------
    list of Frame
        With the channels that programs take; good ones only.
    """
    spec = read_scene(scene)
    with open_driver(spec.driver, spec.driver_options, base=spec.base) as driver:
        conversion = conversion_for(spec.calibration, driver, spec.base)
        read, channels = conversion.reader(conversion.channels), conversion.channels
        return [
            Frame(read(frame), channels, "strain", frame.sequence, frame.time)
            for frame in driver.frames()
            if not frame.quality
        ]


def channelwise(template: Template, spec: RunSpec) -> Program:
    """Return the program that runs a template of one layer on every channel of a frame."""

    @program
    def every_channel(frame: FrameFields) -> dict[str, Field]:
        return {
            name: transient(template, input=frame.channel(name), spec=spec).outputs[0]
            for name in frame.channels
        }

    return every_channel
