"""The cover undone by a network: three layers whose equilibrium is regularised least squares.

K is the response of each taxel to uniform loads on cells (Love, Cerruti). Of all loads q on an
endless surface that explain the taxels' signals s, the likely one is

    q = P Kᵀ r,        dr/dt = s − K P Kᵀ r − μ r

at rest (Tikhonov; P says how large a drag is likely against a pressure). r lives on the taxels, and
K P Kᵀ is a template: the coupling of two taxels depends on how they lie to each other alone. A zero
boundary makes the finite array exact.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve

from cnnum.arrays import Floats
from cnnum.errors import ProgramError
from cnnum.tactile import halfspace
from cnnum.templating.template import Template

WAVES = 64
"""Wave numbers to each axis over which noise is summed."""


@dataclass(frozen=True, slots=True)
class LoadNetwork:
    """The network of one cover.

    Attributes
    ----------
    thickness, pitch : float, m
    youngs_modulus : float, Pa
    noise : float
        RMS of the noise of each strain.
    likely : float, Pa
        RMS of the pressures that are taken as likely. μ = (noise/likely)² is the weight of Wiener's
        filter for loads and noise without correlation, in strain²/Pa².
    drag : float
        RMS of the likely tractions along each axis of the surface, over that of the pressures.
    reach : int
        Taxels, along each axis, over which a load is felt.

    Raises
    ------
    ProgramError
        If one of them is not above 0.
    """

    thickness: float
    pitch: float
    youngs_modulus: float
    noise: float
    likely: float
    drag: float
    reach: int

    def __post_init__(self) -> None:
        cover = (self.thickness, self.pitch, self.youngs_modulus)
        sizes = (*cover, self.noise, self.likely, self.drag)
        if not all(0 < size < math.inf for size in sizes) or self.reach < 1:
            raise ProgramError(
                "A surface load needs thickness, pitch, Young's modulus, noise, likely load and "
                f"drag above 0 and a reach of 1 or more, got {sizes} and {self.reach}."
            )

    def influence(self) -> Floats:
        """Return (strain, load, 2 reach + 1, 2 reach + 1), 1/Pa, as a template's weights."""
        steps = self.pitch * np.arange(self.reach, -self.reach - 1, -1.0)
        found = [
            halfspace.rectangle_strain(
                steps[None, :],
                steps[:, None],
                self.thickness,
                load,
                size=(self.pitch, self.pitch),
                youngs_modulus=self.youngs_modulus,
            )[..., 2, :]
            for load in np.eye(3)
        ]
        return np.moveaxis(np.stack(found), (0, 3), (1, 0))

    @property
    def likely_loads(self) -> Floats:
        """RMS of the likely loads, (3,), Pa."""
        return self.likely * np.array([self.drag, self.drag, 1.0])

    @property
    def noise_of_pressure(self) -> float:
        """Noise of the pressure on an endless array, Pa."""
        waves = np.fft.fft2(self._forward(), s=(WAVES, WAVES), axes=(2, 3))
        seen = np.moveaxis(waves, (0, 1), (2, 3))
        turned = np.conj(seen.swapaxes(2, 3))
        passed = (turned @ np.linalg.inv(seen @ turned + np.eye(3)))[..., 2, :]
        return self.likely * float(np.sqrt((np.abs(passed) ** 2).sum(-1).mean()))

    def template(self) -> Template:
        """Return the CNN; its input is strain over noise, its state the input of `back`."""
        forward = self._forward()
        A = -np.array([[_shared(one, other) for other in forward] for one in forward])
        B = np.eye(3)[:, :, None, None]
        return Template("surface load", A, B, boundary=0.0, duration="settle", output="linear")

    def back(self) -> Template:
        """Return the template that makes loads over likely ones of the network's state."""
        weights = self._forward()[:, :, ::-1, ::-1].swapaxes(0, 1)
        return _filter("loads of taxels", weights)

    def forth(self) -> Template:
        """Return the template that makes strains over noise of loads over likely ones."""
        return _filter("taxels under loads", self._forward())

    def _forward(self) -> Floats:
        return self.influence() * (self.likely_loads / self.noise)[:, None, None]


def _shared(one: Floats, other: Floats) -> Floats:
    """Return the coupling of two strains, by how their taxels lie to each other."""
    products: Floats = fftconvolve(one, other[:, ::-1, ::-1], axes=(-2, -1))
    return np.asarray(products.sum(axis=0))


def _filter(name: str, weights: Floats) -> Template:
    return Template(
        name, np.zeros((3, 3, 1, 1)), weights, boundary=0.0, duration="settle", output="linear"
    )
