"""How far `surface_load` is from true loads: `python -m cnnum.lab.bench.programs.load_errors`.

Frames are Love's and Cerruti's solutions for rectangular contacts at random, with noise. Bias is
weighed against the noise that is let in, for every number of rounds.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.programs.library import get_program
from cnnum.tactile.halfspace import SurfaceToDepth, strain_transfer

CELLS, PITCH, THICKNESS, MODULUS, LIKELY = 16, 1.5e-3, 1.0e-3, 0.87e6, 3e3
NOISES = (1e-3, 3e-4, 1e-4)
ROUNDS = (0, 1, 2, 4, 8)


@dataclass(frozen=True, slots=True)
class LoadError:
    """Results of `surface_load` on many contacts.

    Attributes
    ----------
    noise : float
        RMS of each strain.
    drag : float
    rounds : int
    height, spread : float
        Found over true pressure of the taxels touched, mean and standard deviation of the frames.
    ground : float, Pa
        Mean pressure found where nothing touches.
    rms, rms_drag : float, Pa
        Of the error of the pressure and of the tractions along the surface, all taxels.
    noise_gain : float, Pa
        RMS change of the pressure of touched taxels under another draw of the same noise.
    seconds : float
        Median of a frame of a stream.
    pressure : (frames, rows, cols) float, Pa
        As found.
    """

    noise: float
    drag: float
    rounds: int
    height: float
    spread: float
    ground: float
    rms: float
    rms_drag: float
    noise_gain: float
    seconds: float
    pressure: Floats


def contacts(count: int, seed: int = 0) -> Floats:
    """Return (frames, rows, cols, 3) loads of one to three contacts, dragged by up to a half."""
    rng = np.random.default_rng(seed)
    loads = np.zeros((count, CELLS, CELLS, 3))
    for load in loads:
        for _ in range(rng.integers(1, 4)):
            rows, cols = (int(n) for n in rng.integers(2, 6, 2))
            row, col = (int(rng.integers(0, CELLS - n + 1)) for n in (rows, cols))
            pressure, angle = rng.uniform(4e3, 12e3), rng.uniform(0.0, 2 * np.pi)
            drag = pressure * rng.uniform(0.0, 0.5)
            load[row : row + rows, col : col + cols] = (
                drag * np.cos(angle),
                drag * np.sin(angle),
                pressure,
            )
    return loads


def measure(
    engine: Engine,
    noise: float,
    rounds: int,
    *,
    drag: float = 0.3,
    count: int = 200,
    timed: bool = True,
) -> LoadError:
    """Return the row of a noise and a number of rounds; seconds are NaN where it is not timed."""
    true = contacts(count)
    strain = SurfaceToDepth((CELLS, CELLS), PITCH, THICKNESS, youngs_modulus=MODULUS)(true)
    bound = get_program("surface_load").bind(noise=noise, rounds=rounds, drag=drag)
    names = ["load_x", "load_y", "load_normal"]
    plan = engine.compile(bound, (CELLS, CELLS), names)
    result: list[Floats] = []
    for seed in (1, 2):
        drawn = np.random.default_rng(seed).normal(0.0, noise, strain.shape)
        got = plan(strain + drawn)
        result.append(np.stack([got[name] for name in names], axis=-1))
    on, off = true[..., 2] > 0, result[0] - true
    pressure = result[0][..., 2]
    height = (pressure * on).sum((1, 2)) / (true[..., 2] * on).sum((1, 2))
    return LoadError(
        noise,
        drag,
        rounds,
        height=float(height.mean()),
        spread=float(height.std()),
        ground=float(pressure[~on].mean()),
        rms=float(np.sqrt((off[..., 2] ** 2).mean())),
        rms_drag=float(np.sqrt((off[..., :2] ** 2).mean())),
        noise_gain=float((result[1][..., 2] - pressure)[on].std() / np.sqrt(2.0)),
        seconds=_seconds(plan.stream().push, strain[:50]) if timed else math.nan,
        pressure=pressure,
    )


def _seconds(push: Callable[[Floats], object], frames: Floats) -> float:
    taken: list[float] = []
    for frame in frames:
        begin = time.perf_counter()
        push(frame)
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken))


def kept(noise: float, drag: float, wavelength: Floats) -> Floats:
    """Return the share of a wave of pressure that least squares gives back, by the transform.

    Long waves of pressure and of a pull along them strain alike: the signal is shared out, by
    how likely each is. Short ones drown.

    Parameters
    ----------
    noise : float
    drag : float
        Likely pull over likely pressure.
    wavelength : (...) float, m

    Returns
    -------
    (...) float
    """
    k = 2 * np.pi / np.asarray(wavelength, dtype=np.float64)
    passes = strain_transfer(k, 0.0 * k, THICKNESS, youngs_modulus=MODULUS)
    seen = passes * (LIKELY / noise) * np.array([drag, drag, 1.0])
    turned = np.conj(seen.swapaxes(-1, -2))
    share = turned @ np.linalg.solve(seen @ turned + np.eye(3), seen)
    return np.asarray(np.real(share[..., 2, 2]), dtype=np.float64)


WAVELENGTHS = (3e-3, 4e-3, 6e-3, 9e-3, 12e-3, 18e-3, 24e-3, 48e-3)


def main() -> None:
    """Print the table of errors, and the transform's results on waves."""
    engine = Engine()
    print(
        "| noise | drag | rounds | height | spread | ground, Pa | RMS, Pa | drag RMS, Pa | ", end=""
    )
    print("noise in it, Pa | frame, ms |")
    for noise in NOISES:
        settings = [(1.0, 0), *((0.3, rounds) for rounds in ROUNDS)]
        for drag, rounds in settings:
            row = measure(engine, noise, rounds, drag=drag)
            print(
                f"| {noise:g} | {drag:g} | {rounds} | {row.height:.2f} | {row.spread:.2f} | "
                f"{row.ground:.0f} | {row.rms:.0f} | {row.rms_drag:.0f} | {row.noise_gain:.0f} | "
                f"{1e3 * row.seconds:.2f} |",
                flush=True,
            )
    print("share of a wave of pressure that comes back, by its length in mm")
    print("| noise | drag |", *(f"{1e3 * w:g} |" for w in WAVELENGTHS))
    for noise in NOISES:
        for drag in (1.0, 0.3):
            shares = kept(noise, drag, np.array(WAVELENGTHS))
            print(f"| {noise:g} | {drag:g} |", *(f"{share:.2f} |" for share in shares))


if __name__ == "__main__":
    main()
