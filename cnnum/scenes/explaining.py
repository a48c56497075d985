"""Why slip or twist was reported at a time, or was not: the read-outs against the level."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

import numpy as np

from cnnum.scenes.events import Outputs

FLAGS = {"slip": "gross_slip", "twist": "twist"}
"""Kinds that are explained, and the flag of each."""

CAUSES = {
    "trend": "the load has lately grown or fallen",
    "load_rate": "the load changes",
    "ratio_rate": "the ratio of shear to load still changes",
}
"""Read-outs of slip that explain a movement, in words."""

STICKS, AHEAD = 0.5, 1 / 3
"""Share of the contact that sticks from which nothing slides; cosine of the motion to the shear
from which it counts in full."""


@dataclass(frozen=True, slots=True)
class Explained:
    """A report of slip or twist against its level, at one frame.

    Attributes
    ----------
    kind : "slip" or "twist"
    time : float, s
    frame : int
    reported : bool
    strength, level : float
    read_outs : mapping of str to float
        The other numbers behind the strength, by the names of the outputs.
    why : str
        What held the strength back most, or what it rests on.
    """

    kind: str
    time: float
    frame: int
    reported: bool
    strength: float
    level: float
    read_outs: Mapping[str, float]
    why: str

    @property
    def margin(self) -> float:
        """Strength over level: 1 and above is reported."""
        return self.strength / self.level if self.level > 0.0 else inf

    def __str__(self) -> str:
        said = f"{self.kind} is reported" if self.reported else f"no {self.kind} is reported"
        return (
            f"At {self.time:.3f} s (frame {self.frame}) {said}: the strength is "
            f"{self.strength:.3g}, {self.margin:.3g} of the level {self.level:.3g}; {self.why}."
        )

    def record(self) -> dict[str, object]:
        """Return it as a JSON object."""
        return {
            "kind": self.kind, "t": self.time, "frame": self.frame, "reported": self.reported,
            "strength": self.strength, "level": self.level, "margin": self.margin,
            "read_outs": dict(self.read_outs), "why": self.why,
        }  # fmt: skip


def explained(
    kind: str, time: float, frame: int, outputs: Outputs, weights: Mapping[str, float]
) -> Explained:
    """Return the explanation of one kind from the outputs of a frame.

    Parameters
    ----------
    kind : "slip" or "twist"
    time, frame : float (s), int
    outputs : mapping
        All outputs whose names begin with the kind, and its flag.
    weights : mapping
        `still`, `swing` and `pull` of `slip`.
    """
    numbers = {n: float(v) for n, v in outputs.items() if np.ndim(v) == 0}
    strength, level = numbers[f"{kind}_strength"], numbers[f"{kind}_level"]
    others = {
        name: value
        for name, value in numbers.items()
        if name.startswith(f"{kind}_") and name not in (f"{kind}_strength", f"{kind}_level")
    }
    why = _slip(others, weights) if kind == "slip" else _twist(strength, others)
    flag = numbers[FLAGS[kind]] > 0.0
    if flag and strength < level:
        why = f"it was above its level a moment ago; {why}"
    return Explained(kind, time, frame, flag, strength, level, others, why)


def _slip(numbers: Mapping[str, float], weights: Mapping[str, float]) -> str:
    at = {name.removeprefix("slip_"): value for name, value in numbers.items()}
    if at["ratio"] == 0.0 and at["pattern_speed"] == 0.0:
        return "the rest is still learned, or nothing moves"
    if at["stick_share"] >= STICKS:
        return f"{at['stick_share']:.0%} of the load is on cells that stick"
    shares = {
        "still": weights["still"],
        "trend": at["trend"],
        "load_rate": weights["swing"] * at["load_rate"],
        "ratio_rate": weights["pull"] * at["ratio_rate"],
    }
    whole = sum(shares.values())
    most = max(shares, key=lambda name: shares[name])
    moves = (at["pattern_speed"] ** 2 * at["incoherent_shear"]) ** (1 / 3)
    said = f"it moves by {moves:.3g}/s under a ratio of shear to load of {at['ratio']:.2g}"
    if most == "still":
        said += ", and nothing else explains that"
    else:
        said += f", and {shares[most] / whole:.0%} of what explains it is that {CAUSES[most]}"
    if at.get("motion_cosine", 1.0) < AHEAD:
        said += f"; it moves little along its shear (cosine {at['motion_cosine']:.2g})"
    return said


def _twist(strength: float, numbers: Mapping[str, float]) -> str:
    ratio, apart = numbers["twist_ratio"], numbers["twist_divergence"]
    if strength == 0.0:
        return "the rest is still learned, or no shear turns"
    if strength <= ratio:
        return f"the curl is below the ratio of shear to load ({ratio:.2g}): it is pulled"
    return f"the ratio of shear to load is {ratio:.2g} and the divergence {apart:.2g}"
