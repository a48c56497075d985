"""Piezoresistive silicon: stress in a bridge to its change of resistance."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats, finite
from cnnum.errors import ArrayError, PhysicsError


@dataclass(frozen=True, slots=True)
class Piezoresistor:
    """A p-type resistor along (110) on a (100) wafer.

    Attributes
    ----------
    pi_11, pi_12, pi_44 : float, 1/Pa
        Piezoresistive coefficients. The dissertation prints them without their factor 1e-11.

    References
    ----------
    Vásárhelyi 2007, (3.5)–(3.7); the second line of (3.6) is π_t, printed as π_l.
    """

    pi_11: float = 6.6e-11
    pi_12: float = -1.1e-11
    pi_44: float = 138.1e-11

    def __post_init__(self) -> None:
        if not np.isfinite([self.pi_11, self.pi_12, self.pi_44]).all() or self.pi_44 == 0.0:
            raise PhysicsError(
                "The piezoresistive coefficients must be finite and 'pi_44' not zero, got "
                f"{self.pi_11}, {self.pi_12}, {self.pi_44}; silicon's are about 1e-9 /Pa."
            )

    @property
    def longitudinal(self) -> float:
        """π_l, 1/Pa: along the current (3.6)."""
        return 0.5 * (self.pi_11 + self.pi_12 + self.pi_44)

    @property
    def transversal(self) -> float:
        """π_t, 1/Pa: across the current (3.6)."""
        return 0.5 * (self.pi_11 + self.pi_12 - self.pi_44)

    def resistance_change(
        self, longitudinal: ArrayLike, transversal: ArrayLike, *, exact: bool = False
    ) -> Floats:
        """Return ΔR/R of a resistor under stress.

        Parameters
        ----------
        longitudinal, transversal : (...) float, Pa
            Stress along and across the current; tension is positive.
        exact : bool
            Keep π11 and π12 (3.5), instead of π44 alone (3.7).

        Returns
        -------
        (...) float
        """
        along = finite("longitudinal", longitudinal)
        across = finite("transversal", transversal)
        if exact:
            return self.longitudinal * along + self.transversal * across
        return 0.5 * self.pi_44 * (along - across)


def von_mises(principal: ArrayLike) -> Floats:
    """Return the von Mises stress of three principal stresses.

    Parameters
    ----------
    principal : (..., 3) float, Pa

    Returns
    -------
    (...) float, Pa

    Raises
    ------
    ArrayError
        If the last axis does not hold three stresses.

    References
    ----------
    Vásárhelyi 2007, (3.2).
    """
    stress = finite("principal", principal)
    if stress.ndim == 0 or stress.shape[-1] != 3:
        raise ArrayError(
            f"'principal' must have the shape (..., 3), three principal stresses, got "
            f"{stress.shape}."
        )
    gaps = stress - np.roll(stress, 1, axis=-1)
    return np.asarray(np.sqrt(0.5 * np.sum(gaps**2, axis=-1)), dtype=np.float64)
