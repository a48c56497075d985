"""False alarms: slip or twist reported where there is none."""

from collections.abc import Iterator, Sequence

from cnnum.lab.scoring.judge import Judgement, doing
from cnnum.lab.scoring.measures import Measure, share


def alarm_measures(
    suite: str, judged: Sequence[Judgement], *, target: float | None = None
) -> Iterator[Measure]:
    """Yield false slip and twist reports, in all, a minute, and by what the hand did meanwhile.

    Parameters
    ----------
    suite : str
    judged : sequence of Judgement
    target : float, optional
        How many there may be in all.
    """
    alarms = [(one, event) for one in judged for event in one.alarms]
    minutes = sum(one.play.seconds for one in judged) / 60.0
    scenes = len(judged)
    total = float(len(alarms))
    yield Measure("false slip and twist", suite, total, scenes, "reports", target, "at most")
    yield Measure("false slip and twist a minute", suite, share(total, minutes), scenes, "/min")
    yield Measure("time scored", suite, minutes, scenes, "min")
    for kind in ("slip", "twist"):
        some = float(sum(event.kind == kind for _, event in alarms))
        yield Measure(f"false {kind}", suite, some, scenes, "reports")
    causes = [doing(one.play, event.frame) for one, event in alarms]
    for cause in sorted(set(causes)):
        yield Measure(f"false during {cause}", suite, float(causes.count(cause)), scenes, "reports")
