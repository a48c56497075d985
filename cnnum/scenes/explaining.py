"""Why slip or twist was reported at a time, or was not: the read-outs against the level."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from math import inf

import numpy as np

from cnnum.scenes.events import Outputs

FLAGS = {"slip": "gross_slip", "twist": "twist"}
"""Kinds that are explained, and the flag of each."""

CAUSES = {
    "trend": "the load has lately grown or fallen",
    "load_rate": "the load changes",
    "swings": "the load has just swung",
    "ratio_rate": "the ratio of shear to load still changes",
}
"""Read-outs of slip that explain a movement, in words."""

WEIGHTS = ("still", "swing", "look", "pull")
"""Parameters of `slip` that weigh what a movement is divided by."""

STICKS, AHEAD, ALIGNED, PULLED = 0.5, 1 / 3, 0.3, 2.0
"""Share of the contact that sticks from which nothing slides; cosines of the motion to the shear,
and of the shear's map to the load's, from which a slip counts in full; least curl over the ratio of
shear to load. As in the programs."""


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
    holds : mapping of str to float, 1/s
        What the movement of a slip is divided by, each with its weight; empty for other kinds.
    """

    kind: str
    time: float
    frame: int
    reported: bool
    strength: float
    level: float
    read_outs: Mapping[str, float]
    why: str
    holds: Mapping[str, float] = field(default_factory=dict[str, float])

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
            "read_outs": dict(self.read_outs), "why": self.why, "holds": dict(self.holds),
        }  # fmt: skip


def explained_kinds(outputs: Collection[str]) -> tuple[str, ...]:
    """Return the kinds that can be explained by a program's outputs."""
    return tuple(kind for kind in FLAGS if f"{kind}_level" in outputs)


def read_outs_of(kinds: Collection[str], outputs: Collection[str]) -> list[str]:
    """Return the outputs of a program that explain some kinds."""
    return [
        name
        for name in outputs
        if any(name == FLAGS[kind] or name.startswith(f"{kind}_") for kind in kinds)
    ]


def explained(
    outputs: Outputs, kinds: Collection[str], time: float, frame: int, weights: Mapping[str, float]
) -> tuple[Explained, ...]:
    """Return the explanation of each kind from the outputs of a frame.

    Parameters
    ----------
    outputs : mapping
        All outputs that `read_outs_of` names.
    kinds : collection of "slip" or "twist"
    time, frame : float (s), int
    weights : mapping
        `WEIGHTS` of `slip`.
    """
    numbers = {n: float(v) for n, v in outputs.items() if np.ndim(v) == 0}
    return tuple(_of_kind(kind, time, frame, numbers, weights) for kind in kinds)


def _of_kind(
    kind: str, time: float, frame: int, numbers: Mapping[str, float], weights: Mapping[str, float]
) -> Explained:
    strength, level = numbers[f"{kind}_strength"], numbers[f"{kind}_level"]
    others = {
        name: value
        for name, value in numbers.items()
        if name.startswith(f"{kind}_") and name not in (f"{kind}_strength", f"{kind}_level")
    }
    holds = _holds(others, weights) if kind == "slip" else {}
    why = _slip(others, holds) if kind == "slip" else _twist(strength, others)
    flag = numbers[FLAGS[kind]] > 0.0
    if flag and strength < level:
        why = f"it was above its level a moment ago; {why}"
    return Explained(kind, time, frame, flag, strength, level, others, why, holds)


def _holds(numbers: Mapping[str, float], weights: Mapping[str, float]) -> dict[str, float]:
    return {
        "still": weights["still"],
        "trend": numbers["slip_trend"],
        "load_rate": weights["swing"] * numbers["slip_load_rate"],
        "swings": weights["look"] * numbers["slip_swings"] ** 2,
        "ratio_rate": weights["pull"] * numbers["slip_ratio_rate"],
    }


def _slip(numbers: Mapping[str, float], holds: Mapping[str, float]) -> str:
    at = {name.removeprefix("slip_"): value for name, value in numbers.items()}
    if at["ratio"] == 0.0 and at["pattern_speed"] == 0.0:
        return "the rest is still learned, or nothing moves"
    if at["stick_share"] >= STICKS:
        return f"{at['stick_share']:.0%} of the load is on cells that stick"
    most = max(holds, key=lambda name: holds[name])
    moves = (at["pattern_speed"] ** 2 * at["incoherent_shear"]) ** (1 / 3)
    said = f"it moves by {moves:.3g}/s under a ratio of shear to load of {at['ratio']:.2g}"
    if most == "still":
        said += ", and nothing else explains that"
    else:
        share = holds[most] / sum(holds.values())
        said += f", and {share:.0%} of what explains it is that {CAUSES[most]}"
    along, lies = at.get("motion_cosine", AHEAD), at.get("alignment", ALIGNED)
    if lies < ALIGNED and max(lies, 0.0) / ALIGNED <= ((1.0 + along) / (1.0 + AHEAD)) ** 2:
        said += f"; its shear does not lie where it presses (cosine {lies:.2g})"
    elif along < AHEAD:
        said += f"; it moves little along its shear (cosine {along:.2g})"
    return said


def _twist(strength: float, numbers: Mapping[str, float]) -> str:
    ratio, apart = numbers["twist_ratio"], numbers["twist_divergence"]
    if strength == 0.0:
        return "the rest is still learned, or no shear turns"
    if strength <= PULLED * ratio:
        return (
            f"the curl is below {PULLED:g} times the ratio of shear to load ({ratio:.2g}): "
            "it is pulled"
        )
    return f"the ratio of shear to load is {ratio:.2g} and the divergence {apart:.2g}"
