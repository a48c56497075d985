"""The scenes in which most went wrong, so that whoever improves a program knows where to look."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from cnnum.lab.scoring.judge import Judgement, faults


@dataclass(frozen=True, slots=True)
class Failing:
    """A scene in which something went wrong.

    Attributes
    ----------
    suite, name : str
    seed : int or None
        Gives the scene again: `cnnum score --suite SUITE --seed SEED --count 1`.
    wrong : tuple of str
        False reports first.
    about : mapping
        What sets the scene apart.
    """

    suite: str
    name: str
    seed: int | None
    wrong: tuple[str, ...]
    about: dict[str, object] = field(default_factory=dict[str, object])

    def record(self) -> dict[str, object]:
        """Return it as a JSON object."""
        return {
            "worst": self.name,
            "suite": self.suite,
            "seed": self.seed,
            "wrong": list(self.wrong),
            **self.about,
        }


def failing(judged: Iterable[Judgement]) -> list[Failing]:
    """Return the scenes with something wrong, those with most of it first."""
    found = [
        Failing(one.play.suite, one.play.name, one.play.seed, wrong, dict(one.play.about))
        for one in judged
        if (wrong := tuple(faults(one)))
    ]
    return sorted(found, key=lambda item: (-len(item.wrong), item.name))
