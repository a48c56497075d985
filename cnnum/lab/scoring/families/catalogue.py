"""All families of scenes, by name."""

from dataclasses import dataclass
from typing import Literal

from cnnum.drivers.simulated import grips as pulls
from cnnum.drivers.simulated import hands as held
from cnnum.drivers.simulated.grips import SHAKEN, Array, Make, Skin, pulled, twisted
from cnnum.lab.scoring.families import faces
from cnnum.lab.scoring.families.dragged import dragged

Kind = Literal["slip", "twist", "held"]

EVEN = pulls.power(1.0)


@dataclass(frozen=True, slots=True)
class Family:
    """A family of scenes.

    Attributes
    ----------
    name : str
    kind : "slip", "twist" or "held"
        The kind of event; in "held" nothing slips.
    make : callable
        From shared arrays, the name and a seed to a trial.
    about : str
        Its distinction.
    """

    name: str
    kind: Kind
    make: Make
    about: str


FAMILIES = (
    Family("constant speed", "slip", pulled(EVEN), "how it is pulled"),
    *(
        Family(f"t^{power:g}", "slip", pulled(pulls.power(power)), "how it is pulled")
        for power in (0.5, 0.7, 1.5, 2.0, 3.0)
    ),
    Family("force ramp", "slip", pulled(pulls.force_ramp), "how it is pulled"),
    Family("tremor", "slip", pulled(pulls.tremor), "how it is pulled"),
    Family("stick-slip", "slip", pulled(pulls.weakening), "how it is pulled"),
    Family("flat punch", "slip", dragged(faces.punch), "what touches"),
    Family("ring", "slip", dragged(faces.ring), "what touches"),
    Family("bar", "slip", dragged(faces.bar), "what touches"),
    Family("two bodies", "slip", dragged(faces.two_bodies), "what touches"),
    Family("ridges", "slip", dragged(faces.ridges), "what touches"),
    Family("rough face (tamaas)", "slip", dragged(faces.rough), "what touches"),
    Family("layer", "slip", pulled(EVEN, Array(cover="layer")), "cover"),
    Family("bumps", "slip", pulled(EVEN, Array(cover="bumpy")), "cover"),
    Family("shear read ×0.67", "slip", pulled(EVEN, skin=Skin(shear=1 / 1.5)), "cover"),
    Family("shear read ×1.5", "slip", pulled(EVEN, skin=Skin(shear=1.5)), "cover"),
    Family("gains ±20 %", "slip", pulled(EVEN, skin=Skin(gains=0.2)), "taxels"),
    Family("cross-talk 5 %", "slip", pulled(EVEN, skin=Skin(crosstalk=0.05)), "taxels"),
    Family("creep 5 %/s", "slip", pulled(EVEN, skin=Skin(creep=0.05)), "taxels"),
    Family("hysteresis 5 %", "slip", pulled(EVEN, skin=Skin(hysteresis=0.05)), "taxels"),
    Family("saturation", "slip", pulled(EVEN, skin=Skin(limit=0.7)), "taxels"),
    Family("2 dead taxels", "slip", pulled(EVEN, skin=Skin(dead=2)), "taxels"),
    Family("heavy-tailed noise", "slip", pulled(EVEN, skin=Skin(heavy=True)), "taxels"),
    *(
        Family(f"{rate:g} Hz", "slip", pulled(EVEN, Array(rate=rate)), "frames a second")
        for rate in (10.0, 25.0, 1000.0)
    ),
    Family("4×4 taxels", "slip", pulled(EVEN, Array((4, 4), radius=15e-3)), "array"),
    Family("twist", "twist", twisted(), "plain"),
    Family("twist, layer", "twist", twisted(Array(cover="layer")), "cover"),
    Family("twist, bumps", "twist", twisted(Array(cover="bumpy")), "cover"),
    Family("twist, real taxels", "twist", twisted(skin=SHAKEN), "taxels"),
    Family("twist, 10 Hz", "twist", twisted(Array(rate=10.0)), "frames a second"),
    Family("grip", "held", held.held(held.grips), "load changes"),
    Family("press and release", "held", held.held(held.touches), "load comes and goes"),
    Family("part pull", "held", held.part_pulled, "pull stops at 0.3 to 0.7 μP"),
    Family("trembling pull", "held", held.trembling, "the same in a hand that trembles"),
    Family("vibration", "held", held.held(held.vibrates, weighs=True), "under a weight"),
    Family("rolling", "held", held.held(held.rolls), "without a weight"),
    Family("rolling, weight", "held", held.held(held.rolls, weighs=True), "under a weight"),
    Family("grip, real taxels", "held", held.held(held.grips, skin=SHAKEN), "load changes"),
)
"""A table of results has them in this order."""
