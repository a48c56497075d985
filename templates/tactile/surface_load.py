"""The load on the surface of a cover from the signals of taxels under it.

The cover undone by a network: three layers whose equilibrium is regularised least squares.

K is the response of each taxel to uniform loads on cells (Love, Cerruti). Of all loads q on an
endless surface that explain the taxels' signals s, the likely one is

    q = P Kᵀ r,        dr/dt = s − K P Kᵀ r − μ r

at rest (Tikhonov; P says how large a drag is likely against a pressure). r lives on the taxels, and
K P Kᵀ is a template: the coupling of two taxels depends on how they lie to each other alone. A zero
boundary makes the finite array exact.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve

from cnnum.arrays import Floats
from cnnum.graph.nodes import RunSpec
from cnnum.programs import program
from cnnum.programs.fields import Field, length, maximum, minimum, sqrt, square, total
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.programs.transients import transient
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
        If a parameter is out of range.
    """

    thickness: float
    pitch: float
    youngs_modulus: float
    noise: float
    likely: float
    drag: float
    reach: int

    def __post_init__(self) -> None:
        refuse_outside(
            thickness=(self.thickness, 1e-9, 1e3),
            pitch=(self.pitch, 1e-9, 1e3),
            youngs_modulus=(self.youngs_modulus, 1e-9, 1e15),
            noise=(self.noise, 1e-30, 1e30),
            likely=(self.likely, 1e-30, 1e30),
            drag=(self.drag, 1e-6, 1e6),
            reach=(self.reach, 1, 64),
        )

    def influence(self) -> Floats:
        """Return (strain, load, 2 reach + 1, 2 reach + 1), 1/Pa, as a template's weights."""
        steps = self.pitch * np.arange(self.reach, -self.reach - 1, -1.0)
        result = [
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
        return np.moveaxis(np.stack(result), (0, 3), (1, 0))

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
        A = -np.array([[_shared(row, other) for other in forward] for row in forward])
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


def _shared(values: Floats, other: Floats) -> Floats:
    """Return the coupling of two strains, by how their taxels lie to each other."""
    products: Floats = fftconvolve(values, other[:, ::-1, ::-1], axes=(-2, -1))
    return np.asarray(products.sum(axis=0))


def _filter(name: str, weights: Floats) -> Template:
    return Template(
        name, np.zeros((3, 3, 1, 1)), weights, boundary=0.0, duration="settle", output="linear"
    )


PATIENCE = 1e6
"""Time constants after which the network gives up."""


@program
def surface_load(
    frame: FrameFields,
    *,
    thickness: float = 1.0e-3,
    pitch: float = 1.5e-3,
    youngs_modulus: float = 0.87e6,
    noise: float = 1e-4,
    likely: float = 3.0e3,
    drag: float = 0.3,
    reach: int = 7,
    tolerance: float = 1e-4,
    friction: float = 1.0,
    rounds: int = 1,
) -> Mapping[str, Field]:
    """Reconstruct the tractions on the whole surface, for any number of contacts.

    Detail below the noise is lost: the result is smeared over the width of its point response. A
    uniform pressure causes no strain in an incompressible half-space, so a pressure shows only at
    its edges, and the fit to them has a negative offset. Nothing pulls where nothing touches: each
    iteration removes the part below 0 and fits the remaining strain again.

    Parameters
    ----------
    frame : FrameFields
        Tensor strains at the taxels, tension positive: `shear_x`, `shear_y`, `normal`.
    thickness, pitch : float, m
        Thickness of the cover, and pitch of the taxels.
    youngs_modulus : float, Pa
        Young's modulus of the cover.
    noise : float
        RMS of the noise of each strain, as measured at rest.
    likely : float, Pa
        RMS of the pressures that are expected. Together with the noise, it sets the regularisation
        (a Wiener filter).
    drag : float
        RMS of the tractions along each axis of the surface, relative to that of the pressures. Long
        waves of pressure and of traction strain the cover in the same way, and `drag` divides the
        signal between them.
    reach : int
        Distance over which a load is felt, in taxels along each axis.
    tolerance : float
        Tolerance of the equilibrium if the array is too large for one exact product.
    friction : float
        Largest expected coefficient of friction: after the first fit, it limits the tangential
        traction relative to the pressure above the noise.
    rounds : int
        Number of fits after the first. More of them reduce the bias and increase the noise. With 0,
        the result is that of least squares, linear in the strain.

    Returns
    -------
    mapping
        `load_x`, `load_y`, `load_normal`: maps, Pa, a pressure counting as positive; `residual`:
        RMS of the unexplained strain, in units of the noise.

    Raises
    ------
    ProgramError
        If a parameter is out of range.

    References
    ----------
    Tikhonov & Arsenin, Solutions of Ill-Posed Problems (1977).
    """
    refuse_outside(friction=(friction, 1e-9, 1e9), rounds=(rounds, 0, 1000))
    network = LoadNetwork(thickness, pitch, youngs_modulus, noise, likely, drag, reach)
    spec = RunSpec(rtol=tolerance, atol=tolerance, settle_limit=PATIENCE)
    least, holds = network.noise_of_pressure / likely, friction / drag
    strain = [frame.channel(c) * (1.0 / noise) for c in ("shear_x", "shear_y", "normal")]
    load = _fit(network, strain, spec)
    for _ in range(rounds):
        load = _pushing(load, least, holds)
        more = _fit(network, _left(network, strain, load), spec)
        load = [had + new for had, new in zip(load, more, strict=True)]
    if rounds:
        load = _pushing(load, least, holds)
    left = _left(network, strain, load)
    residual = sqrt(total(map(square, left)).mean() * (1.0 / 3.0))
    x, y, normal = (
        weight * float(size) for weight, size in zip(load, network.likely_loads, strict=True)
    )
    return {"load_x": x, "load_y": y, "load_normal": normal, "residual": residual}


def _fit(network: LoadNetwork, strain: list[Field], spec: RunSpec) -> list[Field]:
    """Return the least squares of strain over noise: loads over likely ones."""
    taxels = transient(network.template(), input=strain, spec=spec).states
    return list(transient(network.back(), input=list(taxels)).states)


def _left(network: LoadNetwork, strain: list[Field], load: list[Field]) -> list[Field]:
    seen = transient(network.forth(), input=load).states
    return [had - explained for had, explained in zip(strain, seen, strict=True)]


def _pushing(load: list[Field], least: float, holds: float) -> list[Field]:
    """Return a load that nowhere pulls, and drags by no more than friction holds.

    The pressure above the noise holds. A threshold instead would let rounding decide about
    the whole of a drag.
    """
    x, y, normal = load
    held = maximum(normal - least, 0.0) * holds
    share = minimum(held / maximum(length([x, y]), least), 1.0)
    return [x * share, y * share, maximum(normal, 0.0)]
