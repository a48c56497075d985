"""How fast a load grew at first, against streams of a known law and known noise."""

import numpy as np
import pytest

from cnnum.drivers.simulated.script import Phase
from cnnum.engine import Engine
from cnnum.programs import program
from cnnum.templates.tactile.contact_mechanics.growth_laws import CURVE, TWIST
from cnnum.templates.tactile.contact_mechanics.growth_rate import pace_of
from cnnum.templates.tactile.twist import KNOWN, twist

STREAMS, TIME, FRAMES = 200, 24.0, 36
"""T, and how long the load is watched: to 1.5 T."""

EARLY = 0.3
"""Frames, RMS, by which a load begins before or after its age says so."""


def paces(noise):
    """Return slopes over the true one, and their errors, of loads of 1 at the end, (STREAMS,)."""

    @program
    def told(frame):
        """The pace of a load that all cells are told."""
        before = frame.memory(scalar=True)
        age = before.value + 1.0
        before.store(age)
        pace = pace_of(
            frame,
            TWIST,
            frame.channel("normal").max(),
            runs=age > 0.0,
            age=age,
            offset=frame.constant(EARLY * CURVE[0] / TIME),
            noise=frame.constant(noise**2),
            astray=frame.constant(0.0),
        )
        return {"slope": pace.slope, "error": pace.error}

    rng = np.random.default_rng(3)
    late = EARLY * rng.standard_normal(STREAMS)
    stream = Engine("reference").compile(told, (16, 16)).stream((STREAMS,))
    for n in range(1, FRAMES + 1):
        x = np.maximum(n - late, 0.0) / TIME
        load = 1.0 - np.exp(-np.polyval([*CURVE[::-1], 0.0], x))
        frames = np.zeros((STREAMS, 16, 16, 3))
        frames[..., 2] = (load + noise * rng.standard_normal(STREAMS))[:, None, None]
        got = stream.push(frames)
    return np.ravel(got["slope"]) * TIME / CURVE[0], np.ravel(got["error"])


def test_errors_are_those_told():
    """The noise is 1 % of the load; chi-squared of 200 puts the RMS 5 % off, twice that is let."""
    slope, error = paces(0.01)
    assert np.sqrt(np.mean(((slope - 1.0) / error) ** 2)) == pytest.approx(1.0, abs=0.15)
    assert abs(np.mean(slope) - 1.0) < 0.3 * np.median(error)


def test_more_noise_makes_a_slope_less_known():
    """Four times the noise, four times the error, but for what noise takes from the curve."""
    quiet, loud = (np.median(paces(noise)[1]) for noise in (0.005, 0.02))
    assert 3.0 < loud / quiet < 5.0


@pytest.mark.parametrize(("load", "thickness", "known"), [(0.8, 1e-3, True), (0.25, 2e-3, False)])
def test_a_rate_is_told_once_it_is_known(numba, run, simulate, load, thickness, known):
    """A torque that is weak and short is a twist whose rate is not told; a strong one's is."""
    script = (Phase("hold", 0.4), Phase("press", 0.3, load=load), Phase("hold", 0.3))
    script = (*script, Phase("twist", 0.25, angle=0.25))
    options = {"rate": 100.0, "shape": (4, 4), "thickness": thickness, "seed": 8}
    strain, truth = simulate(script=script, **options)
    bound = twist.bind(depth=thickness / 1.5e-3, rate=100.0)
    got = run(numba, bound, strain, ["twist", "twist_sense", "twist_rate"])
    turned = got["twist"] > 0
    assert turned.any()
    assert (got["twist_sense"][turned] == 1.0).all()
    told = got["twist_rate"][turned & (got["twist_rate"] != 0.0)]
    assert (len(told) > 0) == known
    # 2.8 standard errors at the level, as `KNOWN` says
    assert told == pytest.approx(np.full(len(told), truth["twist_rate"][-1]), rel=2.8 * KNOWN)
