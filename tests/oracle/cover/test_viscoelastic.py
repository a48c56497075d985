"""A creeping cover, sample by sample: against creep and relaxation in closed form and an ODE."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cnnum.errors import PhysicsError
from cnnum.tactile.cover import FlatCover, StandardLinearSolid, at_rest, creep_step

SOLID = StandardLinearSolid(instant_modulus=1.2e6, relaxed_modulus=0.87e6, creep_time=0.08)


def strains(solid, stress, step):
    memory, result = at_rest(()), []
    for value in stress:
        memory = creep_step(solid, memory, value / solid.instant_modulus, step)
        result.append(memory.strain)
    return np.array(result)


@pytest.mark.parametrize("step", [1e-3, 0.05, 3.0])
def test_ramp_then_hold_is_exact_at_any_step(step):
    """The strain under a ramp is the integral of the creep; nothing depends on the step."""
    times = step * np.arange(1, 9)
    got = strains(SOLID, 1e3 * np.minimum(times, 4 * step), step)
    late = 1 / SOLID.relaxed_modulus - 1 / SOLID.instant_modulus

    def integral(t):
        tau = SOLID.creep_time
        return t / SOLID.relaxed_modulus + late * tau * np.expm1(-t / tau)

    wanted = 1e3 * (integral(times) - integral(np.maximum(times - 4 * step, 0)))
    np.testing.assert_allclose(got, wanted, rtol=1e-12)  # rounding of a few steps


def test_step_load_creeps():
    memory = creep_step(SOLID, at_rest(()), 1e3 / SOLID.instant_modulus, 1e-9)
    for n in range(1, 30):
        memory = creep_step(SOLID, memory, 1e3 / SOLID.instant_modulus, 0.01)
        # the step took 1e-9 s to rise, half of that over τ is late
        assert memory.strain == pytest.approx(1e3 * SOLID.creep(0.01 * n), rel=1e-8)


def test_slow_sine_follows_the_complex_modulus():
    frequency, step = 3.0, 1e-4
    t = step * np.arange(1, 20001)
    got = strains(SOLID, 1e3 * np.sin(2 * np.pi * frequency * t), step)
    response = 1e3 / SOLID.complex_modulus(frequency)
    wanted = (response * np.exp(2j * np.pi * frequency * t)).imag
    late = t > 1.0  # e^{-12} of the start is left
    # chords of a sine are off by (ω Δt)²/8 = 4e-7; the start leaves 4e-6
    np.testing.assert_allclose(got[late], wanted[late], atol=1e-5 * np.abs(response))


def test_against_an_ode_solver():
    """σ + (E_∞/E_0) τ σ' = E_∞ (ε + τ ε'): the solid's own equation, solved for ε."""
    rng = np.random.default_rng(3)
    times, loads = np.linspace(0, 0.5, 11), np.append(0, rng.normal(size=10)) * 1e3
    rates = np.diff(loads) / np.diff(times)

    def slope(t, strain):
        n = min(int(t / 0.05 + 1e-12), 9)
        stress = loads[n] + rates[n] * (t - times[n])
        driven = stress + SOLID.relaxation_time * rates[n]
        return (driven / SOLID.relaxed_modulus - strain) / SOLID.creep_time

    strain, wanted = [0.0], []
    for start, end in pairwise(times):
        done = solve_ivp(slope, (start, end - 1e-13), strain, rtol=1e-11, atol=1e-16)
        strain = done.y[:, -1]
        wanted.append(strain[0])
    got = strains(SOLID, loads[1:], 0.05)
    np.testing.assert_allclose(got, wanted, rtol=1e-7)  # the solver's tolerance, added up


def test_relaxation_undoes_creep():
    """∫ relaxation(t - s) d creep(s) = 1: the two are inverse in the sense of convolution."""
    t, n = 0.3, 20000
    s = (np.arange(n) + 0.5) * t / n
    rate = (1 / SOLID.relaxed_modulus - 1 / SOLID.instant_modulus) / SOLID.creep_time
    total = SOLID.relaxation(t) * SOLID.creep(0.0)
    total += (SOLID.relaxation(t - s) * rate * np.exp(-s / SOLID.creep_time)).sum() * t / n
    assert total == pytest.approx(1, rel=1e-9)  # midpoint rule: (Δt/τ)²/24


def test_correspondence_with_covers():
    """Held for long, a creeping cover strains like an elastic one of the relaxed modulus."""
    soft, stiff = (FlatCover(1e-3, m) for m in (SOLID.relaxed_modulus, SOLID.instant_modulus))
    taxels = np.array([[0.0, 0.0], [1e-3, 0.5e-3]])
    at_once = stiff.strain([0.0, 0.0], taxels, [0.1, 0.2, 1.0])
    memory = creep_step(SOLID, at_rest(at_once.shape), at_once, 1e-12)
    np.testing.assert_allclose(memory.strain, at_once, rtol=1e-9)  # no time to creep
    memory = creep_step(SOLID, memory, at_once, 60 * SOLID.creep_time)
    wanted = soft.strain([0.0, 0.0], taxels, [0.1, 0.2, 1.0])
    np.testing.assert_allclose(memory.strain, wanted, rtol=1e-9)


def test_refuses_a_solid_that_stiffens():
    with pytest.raises(PhysicsError, match="relaxed_modulus"):
        StandardLinearSolid(1e6, 2e6, 0.1)
    with pytest.raises(PhysicsError, match="time_step"):
        creep_step(SOLID, at_rest(()), 0.0, 0.0)
