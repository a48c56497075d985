"""The cost of a frame under a plan, so that plans can be compared."""

from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import ArrayError
from cnnum.plan import Explanation
from cnnum.report.record import SceneRecord
from cnnum.scenes.pipeline import Scene


@dataclass(frozen=True, slots=True)
class PlanCost:
    """The measured time of a frame under a plan.

    Attributes
    ----------
    label : str
        Name of the plan in a report.
    explanation : Explanation
    frames : int
        Measured.
    p50_us, p99_us : float
        From a frame in host memory to its events, µs.
    """

    label: str
    explanation: Explanation
    frames: int
    p50_us: float
    p99_us: float

    @classmethod
    def of_record(cls, label: str, record: SceneRecord) -> "PlanCost":
        """Return the cost of a run that was recorded.

        Raises
        ------
        ArrayError
            If no frame of it ran.
        """
        return _cost(label, record.explanation, record.seconds)

    @classmethod
    def measure(cls, label: str, scene: Scene) -> "PlanCost":
        """Run a scene to its end and return the cost of its frames.

        Raises
        ------
        CnnumError
            From the array.
        """
        seconds = [m.seconds if m.outputs else np.nan for m in scene.results()]
        return _cost(label, scene.plan.explain(), np.array(seconds))


def _cost(label: str, explanation: Explanation, seconds: Floats) -> PlanCost:
    ran = 1e6 * seconds[np.isfinite(seconds)]
    if ran.size == 0:
        raise ArrayError(f"The plan '{label}' ran for no frame; a cost needs at least one.")
    low, high = np.percentile(ran, (50, 99)).tolist()
    return PlanCost(label, explanation, int(ran.size), low, high)
