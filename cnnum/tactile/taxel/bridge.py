"""One taxel of bare silicon: four piezoresistive bridges, from the force on them to signals."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats, finite, frozen
from cnnum.errors import ArrayError, PhysicsError, name_error
from cnnum.frame import FORCE_AXES


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
            Whether to use π11 and π12, too (3.5), instead of π44 alone (3.7).

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
        If the last axis does not have three stresses.

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


SIDES = ("left", "right", "top", "bottom")
"""Order of the bridges in the last axis of volts: at −x, +x, +y, −y (Fig. 3.16).

On a map whose rows run along y, "top" is the side of the larger row number.
"""

COMBINE = frozen([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.0], [-0.5, -0.5, -0.5, -0.5]])
"""(T_x, T_y, S_n) = COMBINE @ volts (4.14); the sign makes a push read positive."""


def rows_of(wanted: Sequence[str]) -> list[int]:
    """Return the rows of `COMBINE` that the wanted channels need.

    Raises
    ------
    UnknownNameError
        If a name is not one of ("shear_x", "shear_y", "normal").
    """
    names = (wanted,) if isinstance(wanted, str) else tuple(wanted)
    for name in names:
        if name not in FORCE_AXES:
            raise name_error("channel", name, FORCE_AXES)
    return [FORCE_AXES.index(name) for name in names]


def trailing(name: str, array: Floats, length: int, meaning: str) -> Floats:
    """Return `array` if its last axis has that length.

    Raises
    ------
    ArrayError
        If it has not.
    """
    if array.ndim == 0 or array.shape[-1] != length:
        raise ArrayError(
            f"'{name}' must have the shape (..., {length}), {meaning}, got {array.shape}."
        )
    return array


def apply_matrix(matrix: Floats, vectors: Floats) -> Floats:
    """Return matrix @ vector over the last axes; the matrix may differ from taxel to taxel."""
    if matrix.ndim == 2:
        return np.asarray(vectors @ matrix.T, dtype=np.float64)
    return np.asarray(np.einsum("...ij,...j->...i", matrix, vectors), dtype=np.float64)


_TABLE_FORCE = 10e-3  # N, the load of Table 3.I


@dataclass(frozen=True, slots=True)
class Bridge:
    """Four piezoresistive bridges in half-bridge circuits.

    The defaults are the stresses of Table 3.I at 10 mN, per newton. A positive normal force pushes
    into the silicon and shortens all four bridges. A positive shear shortens the bridge in front of
    it.

    Attributes
    ----------
    normal : float, Pa/N
        α_ln: σ_l − σ_t in each bridge under a normal force.
    shear : float, Pa/N
        α_ls: σ_l − σ_t in the bridges along a shear force.
    transversal : float, Pa/N
        α_ts: the same in the bridges across the force; the dissertation neglects it.
    supply : float, V
        Bias of the half bridges.
    piezoresistor : Piezoresistor
    linear : bool
        Whether ΔV = (V/4) ΔR/R; otherwise, as for a half bridge, (V/4) δ/(1 + δ/2).
    von_mises_normal, von_mises_shear : float, Pa/N
        Largest equivalent stress of a normal and of a shear force.
    yield_stress : float, Pa
        Yield stress of silicon.
    largest_force : float, N
        On bare silicon; sensors broke at 5 to 10 mN, before they reached the yield stress.

    References
    ----------
    Vásárhelyi 2007, (3.8)–(3.11), Table 3.I, Fig. 3.13. (3.11) lacks the factor 1/4 of the half
    bridge, without which the 2.9 mV/mN/V of the text does not follow.
    """

    normal: float = (-203.5e6 + 38.2e6) / _TABLE_FORCE
    shear: float = -(290e6 - 55.6e6) / _TABLE_FORCE
    transversal: float = 0.0
    supply: float = 5.0
    piezoresistor: Piezoresistor = field(default_factory=Piezoresistor)
    linear: bool = True
    von_mises_normal: float = 203.8e6 / _TABLE_FORCE
    von_mises_shear: float = 293.2e6 / _TABLE_FORCE
    yield_stress: float = 250e6
    largest_force: float = 5e-3

    def __post_init__(self) -> None:
        singular = self.normal == 0.0 or abs(self.shear) == abs(self.transversal)
        if singular or not np.isfinite([self.normal, self.shear, self.transversal]).all():
            raise PhysicsError(
                "A bridge needs a finite 'normal' that is not zero and a 'shear' larger than its "
                f"'transversal', got {self.normal}, {self.shear}, {self.transversal} Pa/N."
            )
        if not min(self.supply, self.yield_stress, self.largest_force) > 0.0:
            raise PhysicsError(
                "'supply', 'yield_stress' and 'largest_force' must be positive, got "
                f"{self.supply} V, {self.yield_stress} Pa and {self.largest_force} N."
            )

    @property
    def matrix(self) -> Floats:
        """(4, 3) float, 1/N: ΔR/R of left, right, top, bottom from (F_x, F_y, F_z), (3.8)."""
        s, t, n = self.shear, self.transversal, self.normal
        stress = np.array([[-s, t, n], [s, -t, n], [-t, s, n], [t, -s, n]])
        return 0.5 * self.piezoresistor.pi_44 * stress

    def resistance_change(self, force: ArrayLike) -> Floats:
        """Return ΔR/R of the four bridges (3.8).

        Parameters
        ----------
        force : (..., 3) float, N
            Force on the centre of the taxel.

        Returns
        -------
        (..., 4) float
            Left, right, top, bottom.

        Raises
        ------
        ArrayError
            If the last axis does not have three components.
        """
        load = trailing("force", finite("force", force), 3, "(F_x, F_y, F_z)")
        return apply_matrix(self.matrix, load)

    def voltages(self, force: ArrayLike) -> Floats:
        """Return the change of the four half-bridge voltages, (..., 4) V, before any amplifier.

        Parameter and error are those of `resistance_change`.
        """
        change = self.resistance_change(force)
        scale = 1.0 if self.linear else 1.0 / (1.0 + 0.5 * change)
        return 0.25 * self.supply * change * scale

    def force(self, voltages: ArrayLike) -> Floats:
        """Return the force behind four half-bridge voltages, (3.11) with the half-bridge factor.

        Parameters
        ----------
        voltages : (..., 4) float, V
            Before the amplifier. A part that no force explains (a mismatch of opposite pairs) is
            left out by least squares.

        Returns
        -------
        (..., 3) float, N

        Raises
        ------
        ArrayError
            If the last axis does not have four bridges.
        """
        volts = trailing("voltages", finite("voltages", voltages), 4, f"bridges {SIDES}")
        change = 4.0 * volts / self.supply
        if not self.linear:
            change = change / (1.0 - 0.5 * change)
        return apply_matrix(np.asarray(np.linalg.pinv(self.matrix), dtype=np.float64), change)

    def von_mises_bound(self, force: ArrayLike) -> Floats:
        """Return an upper bound of the von Mises stress, (...) Pa.

        The equivalent stress is a norm, so the sum of normal and shear parts bounds it. A shear
        along a bridge is the worst direction (Table 3.I: 293 against 270 MPa). Parameter and error
        are those of `resistance_change`.
        """
        load = trailing("force", finite("force", force), 3, "(F_x, F_y, F_z)")
        sideways = np.hypot(load[..., 0], load[..., 1])
        return self.von_mises_normal * np.abs(load[..., 2]) + self.von_mises_shear * sideways

    def overloaded(self, force: ArrayLike) -> NDArray[np.bool_]:
        """Return where (...) a force may break the bridges, by its stress bound or `largest_force`.

        Parameter and error are those of `resistance_change`.
        """
        size = np.linalg.norm(np.asarray(force, dtype=np.float64), axis=-1)
        yields = self.von_mises_bound(force) > self.yield_stress
        return np.asarray(yields | (size > self.largest_force))
