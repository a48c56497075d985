"""Response of the half-space to a unit load, and the law of its material.

Displacement, stress and strain are the load times sums of a few harmonic functions of the place. A
point load takes the functions themselves, a uniform rectangle their integrals. A sinusoidal load
takes their Fourier transforms. The sums are the same.

Let r be the distance, V = 1/r, L = ln(r + z), W = z ln(r + z) - r (so W_z = L, L_z = V). The
general solution (Johnson, Contact Mechanics, 3.4-3.9; Boussinesq, Cerruti, Love) splits into the
incompressible part and a part that vanishes with 1 - 2ν::

    u_i  = (1+ν)/(2πE) (S_ij + (1-2ν) D_ij) f_j    S_ij  = δ_ij/r + x_i x_j / r³
    σ_ij = (-M_ijk + (1-2ν) C_ijk) f_k / (2π)      M_ijk = 3 x_i x_j x_k / r⁵
    ε_ij = (1+ν)/E (σ_ij - (ν/π) δ_ij V_k f_k)

No term has 1 - 2ν in a denominator, so ν = 0.5 is a place like any other.
"""

import math
from collections.abc import Callable, Collection, Mapping

import numpy as np
from numpy.typing import ArrayLike

from cnnum.errors import ArrayError
from cnnum.tactile import checks
from cnnum.tactile.checks import Array, broadcasting


@broadcasting
def strain_from_stress(
    stress: ArrayLike, *, youngs_modulus: ArrayLike, poisson: ArrayLike = 0.5
) -> Array:
    """Return the strain that corresponds to a stress.

    Parameters
    ----------
    stress : (..., 3, 3) float, Pa
        Stress tensor.
    youngs_modulus : (...) float, Pa
        Young's modulus.
    poisson : (...) float
        Poisson's ratio, above -1 and at most 0.5.

    Returns
    -------
    (..., 3, 3) float
        Strain tensor; its shear components are half the engineering ones.

    Raises
    ------
    PhysicsError
        If E <= 0, ν is out of range, or a number is not finite.
    ArrayError
        If the last two axes are not 3 by 3.
    """
    field = checks.vector("stress", stress)
    if field.ndim < 2 or field.shape[-2] != 3:
        raise ArrayError(f"'stress': expected shape (..., 3, 3), got {field.shape}.")
    modulus = checks.positive("youngs_modulus", youngs_modulus)
    ratio = checks.poisson_ratio(poisson)
    deviator, trace = _split(field)
    shear = ((1 + ratio) / modulus)[..., None, None]
    volume = ((1 - 2 * ratio) / (3 * modulus) * trace)[..., None, None]
    return np.asarray(shear * deviator + volume * np.eye(3))


def energy_density(stress: Array, youngs_modulus: Array, poisson: Array) -> Array:
    """Return the strain energy density (...), J/m³, of a stress tensor (..., 3, 3), Pa.

    The energies of shape and of volume are summed: both are positive, so nothing cancels.
    """
    deviator, trace = _split(stress)
    shape = (1 + poisson) / (2 * youngs_modulus) * (deviator**2).sum(axis=(-2, -1))
    return np.asarray(shape + (1 - 2 * poisson) / (6 * youngs_modulus) * trace**2)


def _split(stress: Array) -> tuple[Array, Array]:
    trace = np.trace(stress, axis1=-2, axis2=-1)
    return stress - trace[..., None, None] / 3 * np.eye(3), trace


Integrals = Mapping[str, Array]
Evaluate = Callable[[Collection[str]], Integrals]
Influence = Callable[[str, str], Array]

AXES = "xyz"
COMPONENTS = ("xx", "yy", "zz", "yz", "xz", "xy")

# (component, load): sign and name of the function; absent ones are zero
_C = {
    ("xx", "x"): (1, "W_xyy"),
    ("xx", "y"): (1, "W_yyy"),
    ("xx", "z"): (1, "L_yy"),
    ("yy", "x"): (1, "W_xxx"),
    ("yy", "y"): (1, "W_xxy"),
    ("yy", "z"): (1, "L_xx"),
    ("xy", "x"): (-1, "W_xxy"),
    ("xy", "y"): (-1, "W_xyy"),
    ("xy", "z"): (-1, "L_xy"),
}
_D = {
    ("x", "x"): (-1, "W_xx"),
    ("x", "y"): (-1, "W_xy"),
    ("x", "z"): (-1, "L_x"),
    ("y", "x"): (-1, "W_xy"),
    ("y", "y"): (-1, "W_yy"),
    ("y", "z"): (-1, "L_y"),
    ("z", "x"): (1, "L_x"),
    ("z", "y"): (1, "L_y"),
    ("z", "z"): (1, "V"),
}


def _name(kind: str, axes: str) -> str:
    return f"{kind}_{''.join(sorted(axes))}"


def names_of_displacement(compressible: bool) -> set[str]:
    """Return the functions that the displacement needs."""
    names = {_name("S", i + j) for i in AXES for j in AXES}
    return names | {name for _, name in _D.values()} if compressible else names


def names_of_stress(components: Collection[str], compressible: bool) -> set[str]:
    """Return the functions that these stress components need."""
    names = {_name("M", ij + k) for ij in components for k in AXES}
    if compressible:
        names |= {name for (ij, _), (_, name) in _C.items() if ij in components}
    return names


def names_of_strain(components: Collection[str], compressible: bool) -> set[str]:
    """Return the functions that these strain components need."""
    names = names_of_stress(components, compressible)
    if any(ij[0] == ij[1] for ij in components):
        names |= {f"V_{k}" for k in AXES}
    return names


def displacement_table(evaluate: Evaluate, youngs_modulus: Array, poisson: Array) -> Influence:
    """Return the function (i, load) -> u_i under a unit load along `load`, m/N (or m/Pa)."""
    values = evaluate(names_of_displacement(is_compressible(poisson)))

    def displacement(i: str, load: str) -> Array:
        total = values[_name("S", i + load)]
        sign, name = _D[i, load]
        if name in values:
            total = total + (1 - 2 * poisson) * sign * values[name]
        return (1 + poisson) / (2 * math.pi * youngs_modulus) * total

    return displacement


def stress_table(components: Collection[str], evaluate: Evaluate, poisson: Array) -> Influence:
    """Return the function (ij, load) -> σ_ij under a unit load along `load`, 1/m² (or Pa/Pa)."""
    values = evaluate(names_of_stress(components, is_compressible(poisson)))
    return lambda component, load: _stress(component, load, values, poisson)


def strain_table(
    components: Collection[str], evaluate: Evaluate, youngs_modulus: Array, poisson: Array
) -> Influence:
    """Return the function (ij, load) -> ε_ij under a unit load along `load`, 1/N (or 1/Pa)."""
    values = evaluate(names_of_strain(components, is_compressible(poisson)))

    def strain(component: str, load: str) -> Array:
        total = _stress(component, load, values, poisson)
        if component[0] == component[1]:
            total = total - poisson / math.pi * values[f"V_{load}"]
        return (1 + poisson) / youngs_modulus * total

    return strain


def _stress(component: str, load: str, values: Integrals, poisson: Array) -> Array:
    total = -values[_name("M", component + load)]
    sign, name = _C.get((component, load), (0, ""))
    if name in values:
        total = total + (1 - 2 * poisson) * sign * values[name]
    return total / (2 * math.pi)


def displacement_of(
    evaluate: Evaluate, force: Array, youngs_modulus: Array, poisson: Array
) -> Array:
    """Return the displacement (..., 3) under `force` (..., 3)."""
    table = displacement_table(evaluate, youngs_modulus, poisson)
    return np.stack(np.broadcast_arrays(*(_sum(table, i, force) for i in AXES)), axis=-1)


def stress_of(evaluate: Evaluate, force: Array, poisson: Array) -> Array:
    """Return the stress (..., 3, 3) under `force` (..., 3)."""
    table = stress_table(COMPONENTS, evaluate, poisson)
    return tensor({ij: _sum(table, ij, force) for ij in COMPONENTS})


def strain_of(evaluate: Evaluate, force: Array, youngs_modulus: Array, poisson: Array) -> Array:
    """Return the strain (..., 3, 3) under `force` (..., 3)."""
    table = strain_table(COMPONENTS, evaluate, youngs_modulus, poisson)
    return tensor({ij: _sum(table, ij, force) for ij in COMPONENTS})


def _sum(table: Influence, component: str, force: Array) -> Array:
    x, y, z = (table(component, k) * force[..., n] for n, k in enumerate(AXES))
    return np.asarray(x + y + z)


def is_compressible(poisson: Array) -> bool:
    """Return whether the part that vanishes at ν = 0.5 is needed at all."""
    return bool((poisson != 0.5).any())


def tensor(parts: Mapping[str, Array]) -> Array:
    """Return the six components as symmetric matrices (..., 3, 3)."""
    rows = [[parts[name if name in parts else name[::-1]] for name in _row(i)] for i in AXES]
    flat = np.broadcast_arrays(*(part for row in rows for part in row))
    return np.stack(flat, axis=-1).reshape(*flat[0].shape, 3, 3)


def _row(i: str) -> list[str]:
    return [i + j for j in AXES]
