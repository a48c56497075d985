"""The main figures again for each kind of array, rate, cover, thickness and fault."""

from collections.abc import Iterator, Sequence

from cnnum.lab.scoring.events import warnings
from cnnum.lab.scoring.judge import Judgement
from cnnum.lab.scoring.measures import Measure, share
from cnnum.report.verdicts import MAX_DELAY


def group_measures(suite: str, judged: Sequence[Judgement]) -> Iterator[Measure]:
    """Yield gross recall, warnings and false reports of every group of a suite's scenes."""
    found: dict[tuple[str, str], list[Judgement]] = {}
    for one in judged:
        for trait, value in one.play.traits.items():
            found.setdefault((trait, value), []).append(one)
    for trait, value in sorted(found):
        yield from _measures(suite, f"{trait} {value}", found[trait, value])


def _measures(suite: str, group: str, judged: Sequence[Judgement]) -> Iterator[Measure]:
    finds = [find for one in judged for find in one.of("gross slip")]
    value = share(sum(find.in_time for find in finds), len(finds))
    name = f"gross slip: recall within {MAX_DELAY} frames"
    yield Measure(name, suite, value, len(finds), group=group)
    pulls = warnings(judged)
    told = sum(stick is not None for stick in pulls)
    name = "incipient slip before gross slip"
    yield Measure(name, suite, share(told, len(pulls)), len(pulls), group=group)
    twists = [find for one in judged for find in one.of("twist")]
    value = share(sum(find.report is not None for find in twists), len(twists))
    yield Measure("twist: recall", suite, value, len(twists), group=group)
    alarms = float(sum(len(one.alarms) for one in judged))
    yield Measure("false slip and twist", suite, alarms, len(judged), "reports", group=group)
