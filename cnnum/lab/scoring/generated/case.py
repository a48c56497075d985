"""A case: one generated scene, fully described by its seed."""

from dataclasses import dataclass, field

from cnnum.drivers.simulated.settings import Settings
from cnnum.lab.scoring.generated.faults import Faults

SCORING = 1_000_000
"""First seed of the scoring set. Seeds below are for tuning: whoever sets a constant of a program
by looking at results looks at those, and never at these."""


def seed_set(seed: int) -> str:
    """Return the set that a seed belongs to: "tuning" or "scoring"."""
    return "scoring" if seed >= SCORING else "tuning"


@dataclass(frozen=True, slots=True)
class Case:
    """A generated scene.

    Attributes
    ----------
    suite : str
        "slip" or "false-alarms".
    seed : int
        The same suite and seed give the same frames, bit for bit.
    kind : str
        What happens: "pull", "twist", "pull and twist", "part" or "held".
    settings : Settings
        Of the simulated array.
    faults : Faults
        What is done to its voltages.
    """

    suite: str
    seed: int
    kind: str
    settings: Settings
    faults: Faults = field(default_factory=Faults)

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.suite} {self.seed}"

    @property
    def geometry(self) -> tuple[object, ...]:
        """What arrays must have in common to share their influence coefficients."""
        s = self.settings
        return (s.shape, s.cover, s.thickness, s.pitch, s.youngs_modulus, s.bump_radius)

    def traits(self) -> dict[str, str]:
        """Return what scenes are grouped by."""
        s = self.settings
        return {
            "array": f"{s.shape[0]}×{s.shape[1]}",
            "rate": f"{s.rate:g} Hz",
            "cover": s.cover,
            "thickness": f"{s.thickness * 1e3:g} mm",
            "faults": self.faults.name,
        }

    def describe(self) -> dict[str, object]:
        """Return what sets the scene apart, in SI units."""
        s = self.settings
        loads = [phase.load for phase in s.script if phase.kind == "press"]
        speeds = [phase.speed for phase in s.script if phase.kind == "pull"]
        turns = [phase.angle / phase.duration for phase in s.script if phase.kind == "twist"]
        return {
            "kind": self.kind,
            **self.traits(),
            "radius": _rounded(s.radius),
            "load": _rounded(max(loads, default=0.0)),
            "friction": _rounded(s.friction),
            "noise": _rounded(s.noise),
            **({"speed": _rounded(speeds[0])} if speeds else {}),
            **({"twist_rate": _rounded(turns[0])} if turns else {}),
        }


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
