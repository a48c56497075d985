"""Covers that creep: the standard linear solid, sample by sample and exact.

Elastic–viscoelastic correspondence: where Poisson's ratio does not change in time (rubber stays
incompressible), the stress under given tractions is the elastic one. The strain is the elastic
strain of each instant, run through the creep of the material.
"""

import math
import operator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.errors import ArrayError, PhysicsError
from cnnum.safety.values import refuse_on_host
from cnnum.tactile import checks
from cnnum.tactile.checks import Array


@dataclass(frozen=True, slots=True)
class StandardLinearSolid:
    """A spring in series with a spring and damper side by side (Zener).

    Attributes
    ----------
    instant_modulus : float, Pa
        Young's modulus at once, E_0.
    relaxed_modulus : float, Pa
        In the long run, E_∞, at most E_0.
    creep_time : float, s
        Time constant τ of the strain under constant stress.

    Raises
    ------
    PhysicsError
        If a number is not positive, or the relaxed modulus the larger.

    References
    ----------
    Christensen, Theory of Viscoelasticity, 1.6 and 2.1.
    """

    instant_modulus: float
    relaxed_modulus: float
    creep_time: float

    def __post_init__(self) -> None:
        for name in ("instant_modulus", "relaxed_modulus", "creep_time"):
            checks.scalar(name, checks.positive(name, getattr(self, name)))
        if self.relaxed_modulus > self.instant_modulus:
            raise PhysicsError(
                "'relaxed_modulus': expected at most the instantaneous modulus, "
                f"{self.instant_modulus:g} Pa, got {self.relaxed_modulus:g}."
            )

    @property
    def relaxation_time(self) -> float:
        """Time constant of the stress under constant strain, τ E_∞/E_0, s."""
        return self.creep_time * self.relaxed_modulus / self.instant_modulus

    def creep(self, time: ArrayLike) -> Array:
        """Return the strain over a stress of 1 Pa that began at 0, 1/Pa; time (...) s."""
        t = checks.not_negative("time", time)
        late = 1 / self.relaxed_modulus - 1 / self.instant_modulus
        return np.asarray(1 / self.instant_modulus - late * np.expm1(-t / self.creep_time))

    def relaxation(self, time: ArrayLike) -> Array:
        """Return the stress over a strain of 1 that began at 0, Pa; time (...) s."""
        t = checks.not_negative("time", time)
        soon = self.instant_modulus - self.relaxed_modulus
        return np.asarray(self.instant_modulus + soon * np.expm1(-t / self.relaxation_time))

    def complex_modulus(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return E' + iE'' at a frequency, Pa; frequency (...) Hz."""
        turn = 2j * np.pi * checks.finite("frequency", frequency)
        late = 1 / self.relaxed_modulus - 1 / self.instant_modulus
        compliance = 1 / self.instant_modulus + late / (1 + turn * self.creep_time)
        return np.asarray(1 / compliance, dtype=np.complex128)


@dataclass(frozen=True, slots=True, eq=False)
class Creep:
    """The memory of a creeping cover between samples.

    Attributes
    ----------
    elastic : (...) float
        The strain that a cover of the instant modulus had at the last sample.
    delayed : (...) float
        The strain that has come since, on top.
    """

    elastic: Array
    delayed: Array

    @property
    def strain(self) -> Array:
        """(...) float. The strain at the last sample."""
        return self.elastic + self.delayed


def at_rest(shape: tuple[int, ...]) -> Creep:
    """Return the memory of a cover that was never loaded.

    Raises
    ------
    ArrayError
        If the shape is none of an array.
    SizeError
        If the machine has no room for it.
    """
    try:
        sides = tuple(operator.index(side) for side in shape)
    except TypeError:
        sides = (-1,)
    if min(sides, default=0) < 0:
        raise ArrayError(f"'shape': expected whole numbers of at least 0, got {shape!r:.60}.")
    refuse_on_host("The memory of a cover", (math.prod(sides), 1), 16)
    return Creep(np.zeros(sides), np.zeros(sides))


def creep_step(
    solid: StandardLinearSolid, before: Creep, elastic: ArrayLike, time_step: float
) -> Creep:
    """Return the memory one sample on; its `strain` is that at the taxels.

    Exact for a load that changes linearly between samples, at any time step: one exponential.

    Parameters
    ----------
    solid : StandardLinearSolid
    before : Creep
    elastic : (...) float
        Strain at this sample of an elastic cover with the instant modulus under the same load.
    time_step : float, s
        Since the sample before.

    Raises
    ------
    PhysicsError
        If the time step is not positive, or a strain not finite.
    """
    checks.record("solid", solid, StandardLinearSolid)
    checks.record("before", before, Creep)
    now = checks.finite("elastic", elastic)
    ratio = checks.scalar("time_step", checks.positive("time_step", time_step)) / solid.creep_time
    gain = solid.instant_modulus / solid.relaxed_modulus - 1
    lost = -np.expm1(-ratio)  # 1 - e^{-Δt/τ}
    slope = now - before.elastic
    # the delayed strain follows gain·elastic(t) with the time constant τ
    ahead = 1 - lost / ratio
    delayed = before.delayed + lost * (gain * before.elastic - before.delayed)
    return Creep(now, np.asarray(delayed + gain * slope * ahead))
