"""Draws by seed: the array, the grip and its pull."""

from dataclasses import dataclass

import numpy as np

from cnnum.lab.scoring.families.bounds import Bounds, load_of

YOUNGS_MODULUS = 0.87e6
"""Pa, of all covers: strain is dimensionless, so another one only changes the load."""

RATES = (60.0, 100.0, 200.0, 500.0)
THICKNESSES = (0.7e-3, 1.0e-3, 1.4e-3)
PITCH = 1.5e-3
FRICTION = (0.3, 1.0)
RADIUS = (15e-3, 40e-3)
CONTACT = (1.6e-3, 2.8e-3)
SPEED = (0.3e-3, 3e-3)
NOISE = (2e-3, 3e-3)
"""Hz, m, m, none, m (sphere), m (contact radius), m/s, V (Table 3.II)."""

REST, PRESS, HOLD = 0.5, 0.4, 0.4
"""s without contact, of pressing, and of holding, before anything else."""


@dataclass(frozen=True, slots=True)
class Array:
    """The fixed parts of a family's array.

    Attributes
    ----------
    shape : (rows, cols)
    cover : str
        As in the settings of the simulated array.
    rate : float, optional
        Hz; drawn unless given.
    radius : float, optional
        m, of the sphere; drawn unless given.
    contact : float, optional
        m, radius of the contact; drawn unless given.
    """

    shape: tuple[int, int] = (8, 8)
    cover: str = "flat"
    rate: float | None = None
    radius: float | None = None
    contact: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Draw:
    """One scene's numbers.

    Attributes
    ----------
    rng : numpy.random.Generator
        For the numbers that only some scenes need.
    seed : int
    rate : float, Hz
    thickness, start : m
    noise : float, V
    speed : float, m/s
    direction : float, rad
    bounds : Bounds
        Of the grip.
    """

    rng: np.random.Generator
    seed: int
    rate: float
    thickness: float
    start: tuple[float, float]
    noise: float
    speed: float
    direction: float
    bounds: Bounds

    @classmethod
    def of(cls, family: str, seed: int, array: Array) -> "Draw":
        """Return the numbers of a family's scene; the same seed gives the same ones."""
        rng = np.random.default_rng([seed, *family.encode()])
        rate, thickness = float(rng.choice(RATES)), float(rng.choice(THICKNESSES))
        radius, contact = _log(rng, *RADIUS), float(rng.uniform(*CONTACT))
        radius, contact = array.radius or radius, array.contact or contact
        load = load_of(contact, radius, YOUNGS_MODULUS)
        return cls(
            rng=rng,
            seed=seed,
            rate=array.rate or rate,
            thickness=thickness if array.cover == "flat" else 1.0e-3,
            start=(float(rng.uniform(-0.5e-3, 0.5e-3)), float(rng.uniform(-0.5e-3, 0.5e-3))),
            noise=float(rng.uniform(*NOISE)),
            speed=_log(rng, *SPEED),
            direction=float(rng.uniform(-np.pi, np.pi)),
            bounds=Bounds(radius, load, float(rng.uniform(*FRICTION)), YOUNGS_MODULUS),
        )

    def uniform(self, low: float, high: float) -> float:
        """Return a number between two."""
        return float(self.rng.uniform(low, high))

    def log(self, low: float, high: float) -> float:
        """Return a number between two, every octave as likely."""
        return _log(self.rng, low, high)

    def sign(self) -> int:
        """Return −1 or 1."""
        return 1 if self.rng.random() < 0.5 else -1

    def scans(self, seconds: float) -> int:
        """Return the frames in a time, at least one."""
        return max(1, round(seconds * self.rate))


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** rng.random())
