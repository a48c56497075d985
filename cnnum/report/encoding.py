"""A report's data as JSON: all that its pictures and tables are drawn from."""

import base64
import json
from dataclasses import asdict, dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.report.plan_cost import PlanCost
from cnnum.report.record import SceneRecord
from cnnum.report.verdicts import Verdict, compare
from cnnum.report.work_precision import WorkPrecision
from cnnum.sharing import json_value
from cnnum.templating.checks import CheckResult

FORMAT = 1
"""Number of this layout."""

LEVELS = 32_767
MISSING = -32_768
MAP_BYTES = 1_500_000
"""Of all maps together, before base64: a longer recording keeps every second frame, or third…"""


@dataclass(frozen=True, slots=True, eq=False)
class ReportData:
    """The parts of a report.

    Attributes
    ----------
    record : SceneRecord
    checks : tuple of CheckResult
    work_precision : tuple of WorkPrecision
    plans : tuple of PlanCost
    """

    record: SceneRecord
    checks: tuple[CheckResult, ...] = ()
    work_precision: tuple[WorkPrecision, ...] = ()
    plans: tuple[PlanCost, ...] = ()

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """Reported events against the ground truth."""
        return compare(self.record)


def to_json(data: ReportData) -> str:
    """Return the data as JSON that may stand inside a script element."""
    text = json.dumps(as_tree(data), ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")


def as_tree(data: ReportData) -> dict[str, object]:
    """Return the data as values of JSON.

    Series have seven digits; maps are 16-bit integers with a scale, in base64. NaN is null, or
    the integer that "missing" names.
    """
    record, every = data.record, stride(data.record)
    maps = {"values": record.values, **record.maps()}
    series = {name: v for name, v in record.outputs.items() if v.ndim == 1}
    return {
        "cnnum_report": FORMAT,
        "environment": {
            **asdict(record.environment),
            "versions": dict(record.environment.versions),
        },
        "scene": {
            "name": record.name,
            "needs": list(record.needs),
            "shape": list(record.shape),
            "rate_hz": record.rate,
            "pitch_m": record.pitch,
            "channels": list(record.channels),
            "unit": record.unit,
            "push": record.push,
            "frames": record.frames,
        },
        "t": numbers(record.times),
        "seconds": numbers(record.seconds),
        "truth": {name: numbers(values) for name, values in record.truth.items()},
        "outputs": {name: numbers(values) for name, values in series.items()},
        "maps": {"every": every, **{name: packed(v[::every]) for name, v in maps.items()}},
        "events": [event.record() for event in record.events],
        "verdicts": [json_value(asdict(verdict)) for verdict in data.verdicts],
        "explanation": json_value(asdict(record.explanation)),
        "summary": json_value(asdict(record.summary)),
        "checks": [json_value(asdict(check)) for check in data.checks],
        "work_precision": [json_value(asdict(point)) for point in data.work_precision],
        "plans": [json_value(asdict(plan)) for plan in data.plans],
    }


def stride(record: SceneRecord) -> int:
    """Return the distance of the frames whose maps are kept, so that a report stays light."""
    sizes = [record.values.size, *(values.size for values in record.maps().values())]
    return max(1, -(-2 * sum(sizes) // MAP_BYTES))


def numbers(values: Floats) -> list[float | int | None]:
    """Return a series with seven digits, whole numbers without a point."""
    return [number(value) for value in values.tolist()]


def number(value: float) -> float | int | None:
    """Return a number as JSON can have it."""
    if not np.isfinite(value):
        return None
    short = float(f"{value:.7g}")
    return int(short) if short.is_integer() and abs(short) < 1e15 else short


def packed(values: Floats) -> dict[str, object]:
    """Return maps as integers: value = scale · integer."""
    finite = np.isfinite(values)
    top = float(np.abs(values[finite]).max(initial=0.0))
    scale = top / LEVELS or 1.0
    whole = np.full(values.shape, MISSING, dtype="<i2")
    whole[finite] = np.rint(values[finite] / scale).astype("<i2")
    return {
        "dtype": "int16, little-endian, base64",
        "shape": list(values.shape),
        "scale": scale,
        "missing": MISSING,
        "data": base64.b64encode(whole.tobytes()).decode("ascii"),
    }
