"""Drawing cases: what every generated scene has in common, from its seed alone."""

from collections.abc import Callable
from typing import Literal, TypeVar

import numpy as np

from cnnum.drivers.simulated.script import Phase
from cnnum.drivers.simulated.settings import Settings
from cnnum.lab.scoring.generated.bounds import Bounds, load_of
from cnnum.lab.scoring.generated.case import Case
from cnnum.lab.scoring.generated.faults import Faults

YOUNGS_MODULUS = 0.87e6
"""Pa, of all covers: strain is dimensionless, so another one only changes the load."""

Cover = Literal["flat", "bumpy", "bumps-fem"]
SHAPES = (((4, 4), 0.2), ((8, 8), 0.6), ((16, 16), 0.2))
RATES = ((60.0, 0.2), (100.0, 0.25), (200.0, 0.3), (500.0, 0.15), (1000.0, 0.1))
COVERS: tuple[tuple[Cover, float], ...] = (("flat", 0.6), ("bumpy", 0.2), ("bumps-fem", 0.2))
THICKNESSES = (0.7e-3, 1.0e-3, 1.4e-3, 2.0e-3)
FRICTION = (0.3, 1.0)
RADIUS = (15e-3, 40e-3)
"""m, of the sphere."""

CONTACT = (1.6e-3, 2.8e-3)
"""m, contact radius: from one pitch to nearly two."""

CONTACT_4 = 2.2e-3
"""m, the largest on 4×4 taxels, whose outermost stand 2.25 mm from the middle."""

NOISE = (2e-3, 3e-3)
"""V, Table 3.II."""

DRIFT = 10e-3
"""V, Table 3.II: the transient under a cover."""

Script = Callable[["Draw"], tuple[str, tuple[Phase, ...]]]
Kind = TypeVar("Kind")


class Draw:
    """A seed's random numbers, and the array, the sphere and the grip that they give.

    Attributes
    ----------
    rng : numpy.random.Generator
    shape : (rows, cols)
    rate : float, Hz
    bounds : Bounds
        Of the grip that the scene begins with.
    """

    def __init__(self, suite: str, seed: int) -> None:
        self.suite, self.seed = suite, seed
        self.rng = np.random.default_rng([seed, *suite.encode()])
        self.shape = self.chosen(SHAPES)
        self.rate = self.chosen(RATES)
        self.cover: Cover = self._cover()
        self.thickness = THICKNESSES[int(self.rng.integers(len(THICKNESSES)))]
        self.bounds = self._grip()

    def chosen(self, table: tuple[tuple[Kind, float], ...]) -> Kind:
        """Return one of a table's values, by its weight."""
        return table[int(self.rng.choice(len(table), p=[weight for _, weight in table]))][0]

    def uniform(self, low: float, high: float) -> float:
        """Return a number between two."""
        return float(self.rng.uniform(low, high))

    def log(self, low: float, high: float) -> float:
        """Return a number between two, every octave as likely."""
        return float(low * (high / low) ** self.rng.uniform())

    def angle(self) -> float:
        """Return a direction, rad."""
        return self.uniform(-np.pi, np.pi)

    def sign(self) -> float:
        """Return −1 or 1."""
        return 1.0 if self.rng.random() < 0.5 else -1.0

    def case(self, script: Script) -> Case:
        """Return the case of a script."""
        kind, phases = script(self)
        settings = Settings(
            seed=self.seed,
            shape=self.shape,
            rate=self.rate,
            cover=self.cover,
            thickness=self.thickness,
            youngs_modulus=YOUNGS_MODULUS,
            friction=self.bounds.friction,
            radius=self.bounds.radius,
            start=(self.uniform(-0.5e-3, 0.5e-3), self.uniform(-0.5e-3, 0.5e-3)),
            noise=self.uniform(*NOISE),
            script=phases,
        )
        return Case(self.suite, self.seed, kind, settings, self._faults())

    def _cover(self) -> Cover:
        """Return the cover; even bumps over 256 taxels take 12 s to work out, so they get none."""
        cover: Cover = self.chosen(COVERS)
        if cover == "bumpy" and self.shape == (16, 16):
            return "bumps-fem"
        return cover

    def _grip(self) -> Bounds:
        radius = self.log(*RADIUS)
        contact = self.uniform(CONTACT[0], CONTACT_4 if self.shape == (4, 4) else CONTACT[1])
        load = load_of(contact, radius, YOUNGS_MODULUS)
        friction = self.uniform(*FRICTION)
        return Bounds(radius, load, friction, YOUNGS_MODULUS)

    def _faults(self) -> Faults:
        """Return the faults: in a third of the scenes broken taxels, in another third drift."""
        kind = self.rng.random()
        taxels = int(np.prod(self.shape))
        broken = int(self.rng.integers(1, 2 + taxels // 32)) if kind < 1 / 3 else 0
        which = int(self.rng.integers(3))
        warms = 1 / 3 <= kind < 2 / 3
        return Faults(
            seed=self.seed,
            dead=broken if which == 0 else 0,
            stuck=broken if which == 1 else 0,
            noisy=broken if which == 2 else 0,
            drift=DRIFT * self.sign() if warms else 0.0,
            drift_time=self.log(10.0, 180.0),
            begins=self.uniform(-2.5, 2.5) if self.suite == "false-alarms" else 0.0,
        )
