"""The frames that sum up a scene."""

from dataclasses import dataclass

from cnnum.report.record import SceneRecord
from cnnum.report.verdicts import LANES, spans

SHOWN = ("contact", "incipient slip", "gross slip", "twist")


@dataclass(frozen=True, slots=True)
class KeyFrame:
    """A frame that is shown, and its content."""

    title: str
    frame: int


def key_frames(record: SceneRecord) -> tuple[KeyFrame, ...]:
    """Return the frames before a contact, in each of its phases, and while it is let go.

    They follow the ground truth; without one, the reported events.
    """
    found = _by_truth(record) if record.truth else _by_events(record)
    unique = {key.frame: key for key in sorted(found, key=lambda key: key.frame)}
    return tuple(unique.values())


def _by_truth(record: SceneRecord) -> list[KeyFrame]:
    times = {lane.title: spans(record, lane) for lane in LANES}
    contacts = times["contact"]
    if not contacts:
        return [KeyFrame("no contact", record.frames // 2)]
    start, end = contacts[0]
    found = [KeyFrame("before", start // 2)] if start > 1 else []
    slips = [first for name in SHOWN[1:] for first, _ in times[name][:1]]
    found.append(KeyFrame("contact", (start + min([end, *slips])) // 2))
    for name in SHOWN[1:]:
        for first, after in times[name][:1]:
            found.append(KeyFrame(name, (first + after) // 2))
    if end < record.frames:
        found.append(KeyFrame("release", max(start, end - max(2, round(0.15 * record.rate)))))
    return found


def _by_events(record: SceneRecord) -> list[KeyFrame]:
    found = [KeyFrame("before", 0)]
    for event in record.events[:7]:
        found.append(KeyFrame(event.title, min(event.frame, record.frames - 1)))
    return found
