"""What benchmarks run on: templates with all weights in use, and maps of a fixed seed."""

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape
from cnnum.graph.nodes import RunSpec
from cnnum.programs import Program, program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import transient
from cnnum.template import Template

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


def maps(*shape: int) -> Floats:
    """Return maps of numbers between −1 and 1."""
    return generator().uniform(-1.0, 1.0, shape)


def frames(batch: int, shape: Shape, channels: int = 3) -> NDArray[np.float32]:
    """Return a batch of frames as a driver would hand them on."""
    return maps(batch, *shape, channels).astype(np.float32)


def channelwise(template: Template, spec: RunSpec) -> Program:
    """Return the program that runs a template of one layer on every channel of a frame."""

    @program
    def every_channel(frame: FrameFields) -> dict[str, Field]:
        return {
            name: transient(template, input=frame.channel(name), spec=spec).outputs[0]
            for name in frame.channels
        }

    return every_channel
