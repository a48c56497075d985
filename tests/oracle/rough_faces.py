"""Writes the pressures of rough faces that the scoring suite drags over a skin.

They are worked out by tamaas (PyPI, extra `oracles`), which cnnum itself never imports. Run
`python tests/oracle/rough_faces.py FILE.npz` to write them; a test holds the shipped file to it.
"""

import sys
from pathlib import Path

import numpy as np

from cnnum.arrays import Floats

SIDE, HALF, POINTS, COARSE = 6.0e-3, 2.2e-3, 120, 2
"""m, of the map, and half the width of the face; points of the solver, and those put into one."""

MODULUS, LOAD = 1.16e6, 0.4
"""E* (Pa) of 0.87 MPa at ν = 0.5, and the whole load, N."""

ROUGHNESS, WAVES, SLOPE = 20e-6, (2, 12), 1.8
"""RMS height, m; waves a side, and the exponent of their spectrum (Hurst 0.8)."""

LOADS = np.array([0.0, 0.03, 0.08, 0.15, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0])
FACES = 6


def face(seed: int) -> Floats:
    """Return the heights of a face, towards the skin, m; its rim is 1 mm away."""
    rng = np.random.default_rng(seed)
    waves = np.hypot(*np.meshgrid(*[np.fft.fftfreq(POINTS, 1 / POINTS)] * 2))
    inside = (waves >= WAVES[0]) & (waves <= WAVES[1])
    amplitude = np.where(inside, np.maximum(waves, 1.0) ** -SLOPE, 0.0)
    height = np.fft.ifft2(amplitude * np.exp(2j * np.pi * rng.random(waves.shape))).real
    at = np.abs(((np.arange(POINTS) + 0.5) / POINTS - 0.5) * SIDE)
    face = np.maximum(at[:, None], at) < HALF
    height = ROUGHNESS * height / height[face].std()
    return np.where(face, height - height[face].max(), -1e-3)


def solved(surface: Floats, load: float) -> tuple[Floats, float]:
    """Return the pressure (Pa) and the approach (m) that tamaas finds under a load (N)."""
    import tamaas

    tamaas.set_log_level(tamaas.LogLevel.error)
    model = tamaas.Model(tamaas.model_type.basic_2d, [SIDE, SIDE], [POINTS, POINTS])
    model.E, model.nu = MODULUS, 0.0  # so that E* = E
    tamaas.ModelFactory.registerNonPeriodic(model, "dcfft")
    solver = tamaas.PolonskyKeerRey(model, surface, 1e-10)
    solver.setIntegralOperator("dcfft")
    solver.solve(load / SIDE**2)
    pressure, moved = np.array(model.traction), np.zeros((POINTS, POINTS))
    # the solver counts displacements from the face: the skin's own come from its operator
    model.operators["dcfft"](pressure, moved)
    return pressure, float((moved - surface)[pressure > 0].mean())


def table(faces: int = FACES) -> dict[str, Floats]:
    """Return the suite's table: pressures as shares of the largest, approaches in m."""
    pressed, approach = [], []
    for seed in range(faces):
        found = [solved(face(seed), share * LOAD) for share in LOADS[1:]]
        maps = np.stack([np.zeros((POINTS, POINTS)), *(pressure for pressure, _ in found)])
        coarse = maps.reshape(len(LOADS), POINTS // COARSE, COARSE, POINTS // COARSE, COARSE)
        coarse = coarse.mean(axis=(2, 4))
        pressed.append((coarse / coarse.max()).astype(np.float16))
        approach.append([0.0, *(way for _, way in found)])
    radius = 2.0 * HALF / np.pi**0.5
    whole = np.array(approach)[:, -1]
    return {
        "pressed": np.array(pressed),
        "approach": np.array(approach),
        "stiffness": LOAD / (2.0 * MODULUS * radius * whole),
        "loads": LOADS,
        "side": np.array(SIDE),
        "half": np.array(HALF),
    }


if __name__ == "__main__":
    np.savez_compressed(Path(sys.argv[1]), allow_pickle=False, **table())
