"""A case of the suite, and how one engine did on it."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Literal

import numpy as np

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.runs.result import Result

Family = Literal["stiff", "marginal", "extreme", "precision"]
Outcome = Literal["solved", "refused", "failed"]


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """The answer of an engine.

    Attributes
    ----------
    values : (...) float
        In the order of the case's truth.
    estimate : float
        Error that the result states of itself; infinite where it says that nothing is known.
    """

    values: Floats
    estimate: float = inf


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A network or program that is hard to run, with the known facts of its answer.

    Attributes
    ----------
    name : str
        Unique; a method other than "auto" follows after a space.
    family : "stiff", "marginal", "extreme" or "precision"
    title : str
        The difficulty.
    solve : callable
        Runs it on an engine.
    truth : callable
        Returns the answer, from a closed form or from a solver that shares nothing with the engine.
    tolerance, fine : float
        Largest error that passes in single and in double precision.
    reason : str
        Why these tolerances.
    refusal : str
        Regular expression of a sentence with which it may be refused; "" where it may not.
    slow : str
        Why the reference engine leaves it out; "" where it does not.
    patience : float
        Seconds after which it is said to hang; 0 for the usual ones.
    """

    name: str
    family: Family
    title: str
    solve: Callable[[Engine], Solved]
    truth: Callable[[], Floats]
    tolerance: float
    fine: float
    reason: str
    refusal: str = ""
    slow: str = ""
    patience: float = 0.0

    def allowed(self, precision: str) -> float:
        """Return the largest error that passes."""
        return self.tolerance if precision == "float32" else self.fine

    def may_refuse(self, sentence: str) -> bool:
        """Return whether this is a right reason to refuse the case."""
        return bool(self.refusal) and re.search(self.refusal, sentence) is not None


@dataclass(frozen=True, slots=True)
class Row:
    """How an engine did on a case.

    Attributes
    ----------
    case, family, title, engine, precision : str
    outcome : "solved", "refused" or "failed"
        Failed: it ended in an error that is not the project's own, or did not end.
    error : float
        Largest difference from the truth; NaN unless solved.
    estimate : float
        The error that the result stated.
    tolerance : float
    seconds : float
    passed : bool
    why : str
        Why that tolerance, or the sentence of the raised error.
    """

    case: str
    family: str
    title: str
    engine: str
    precision: str
    outcome: Outcome
    error: float
    estimate: float
    tolerance: float
    seconds: float
    passed: bool
    why: str

    @property
    def share(self) -> float:
        """The error as a share of the tolerance; 0 where none is made."""
        return self.error / self.tolerance if self.error > 0.0 else 0.0

    def record(self) -> dict[str, object]:
        """Return the row as `cnnum stability --json` writes it."""
        return {name: getattr(self, name) for name in self.__slots__}


def states(result: Result) -> Solved:
    """Return the states of a run, with the largest error that it states."""
    return Solved(result.state, float(np.max(result.error, initial=0.0)))


def outputs(result: Result) -> Solved:
    """Return the outputs of a run."""
    return Solved(result.output)


def says_settled(result: Result) -> Solved:
    """Return 1 for each frame that says that it is at rest."""
    return Solved(np.asarray(result.settled, dtype=np.float64))
