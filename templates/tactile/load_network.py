"""The cover undone by a network: six layers whose equilibrium is regularised least squares.

Three layers hold the load q on the surface, three what of the taxels' signals s it does not
explain:

    dq/dt = Kᵀ r − μ q,        dr/dt = s − K q − r,

so that at rest (KᵀK + μ) q = Kᵀ s (Tikhonov). K is what a uniform load on one cell does to each
taxel (Love, Cerruti): a template. Its transpose is the same template turned around, and taxels
beyond the rim are not there, so a zero boundary makes the finite array exact.
"""

import math
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import ProgramError
from cnnum.tactile import halfspace
from cnnum.template import Template


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
        RMS of the loads that are taken as likely. (noise/likely)² is the weight of Wiener's
        filter for loads and noise without correlation, in strain²/Pa².
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
    reach: int

    def __post_init__(self) -> None:
        sizes = (self.thickness, self.pitch, self.youngs_modulus, self.noise, self.likely)
        if not all(0 < size < math.inf for size in sizes) or self.reach < 1:
            raise ProgramError(
                "A surface load needs thickness, pitch, Young's modulus, noise and likely load "
                f"above 0 and a reach of 1 or more, got {sizes} and {self.reach}."
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
    def scale(self) -> float:
        """‖K‖ in 1/Pa, by a bound: the largest sum of the weights of one wave's factors."""
        return float(np.abs(self.influence()).sum(axis=(1, 2, 3)).max())

    def template(self) -> Template:
        """Return the CNN; its input is strain over noise, its state load · scale/noise."""
        size = 2 * self.reach + 1
        forward = self.influence() / self.scale
        A, B = np.zeros((6, 6, size, size)), np.zeros((6, 3, size, size))
        A[:3, 3:] = forward[:, :, ::-1, ::-1].swapaxes(0, 1)
        A[3:, :3] = -forward
        middle = self.reach
        for n in range(3):
            # the decay −x of a cell and this make −μ
            A[n, n, middle, middle] = 1.0 - (self.noise / (self.likely * self.scale)) ** 2
            B[3 + n, n, middle, middle] = 1.0
        return Template("surface load", A, B, boundary=0.0, duration="settle", output="linear")
