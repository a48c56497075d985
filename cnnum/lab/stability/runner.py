"""Run cases in a process of their own, which is ended where a case does not end."""

import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from math import inf, isfinite, nan
from multiprocessing import get_context

import numpy as np

from cnnum.engine import Engine
from cnnum.engines.devices.child import safe_path
from cnnum.errors import CnnumError, DeviceError, name_error
from cnnum.lab.stability.cases import closed_forms, extreme, marginal, precision, programs, stiff
from cnnum.lab.stability.record import Case, Outcome, Row, Solved

ROOMS = (stiff, marginal, extreme, precision, programs, closed_forms)


@cache
def all_cases() -> tuple[Case, ...]:
    """Return every case of the suite."""
    return tuple(case for room in ROOMS for case in room.cases())


def by_name(name: str) -> Case:
    """Return a case."""
    return next(case for case in all_cases() if case.name == name)


def select(names: Sequence[str]) -> tuple[Case, ...]:
    """Return the cases whose name begins with one of these, or of that family; all without any.

    Raises
    ------
    UnknownNameError
        If a name is the beginning of none.
    """
    for name in names:
        if not any(_meant(case, name) for case in all_cases()):
            families = dict.fromkeys(case.family for case in all_cases())
            raise name_error("case", name, [*families, *(case.name for case in all_cases())])
    return tuple(
        case for case in all_cases() if not names or any(_meant(case, name) for name in names)
    )


def _meant(case: Case, name: str) -> bool:
    return case.name.startswith(name) or case.family == name


PATIENCE = 60.0
"""Seconds after which a case is said to hang; the slowest takes a tenth of it on two cores."""

ENGINES = (
    ("opencl", "float32"),
    ("opencl", "float64"),
    ("numba", "float32"),
    ("numba", "float64"),
    ("reference", "float64"),
)


def run(
    cases: Iterable[Case], engine: str, precision: str, device: str | None = None
) -> Iterator[Row]:
    """Run cases on one engine.

    Parameters
    ----------
    cases : iterable of Case
    engine, precision : str
    device : str, optional

    Yields
    ------
    Row
        One a case; a case that hangs, or ends its process, fails and stops no other.
    """
    pool: ProcessPoolExecutor | None = None
    try:
        for case in cases:
            pool = pool or _begun(engine, precision, device)
            try:
                running = pool.submit(run_named, case.name, engine, precision, device)
            except BrokenProcessPool:  # its process has died since, which is no fault of this case
                _end(pool)
                pool = _begun(engine, precision, device)
                running = pool.submit(run_named, case.name, engine, precision, device)
            begun, patience = time.perf_counter(), case.patience or PATIENCE
            try:
                yield running.result(patience)
                continue
            except TimeoutError:
                why = f"It did not end within {patience:g} s."
            except BrokenProcessPool:
                why = "It ended its process."
            _end(pool)
            pool = None
            yield _row(case, engine, precision, "failed", time.perf_counter() - begun, why)
    finally:
        if pool is not None:
            pool.shutdown()


def _begun(engine: str, precision: str, device: str | None) -> ProcessPoolExecutor:
    """Return a process that has opened an engine, which is no case's time."""
    with safe_path():
        pool = ProcessPoolExecutor(1, get_context("spawn"))
        opened = pool.submit(_opened, engine, precision, device)
    try:
        opened.result()
    except BrokenProcessPool:
        pool.shutdown()
        raise DeviceError(
            f"Engine '{engine}' ended the process that opened it in {precision}."
        ) from None
    return pool


def _end(pool: ProcessPoolExecutor) -> None:
    """End the process of a pool, amid its work."""
    for process in list(pool._processes.values()):  # there is no other way to it
        process.kill()
    pool.shutdown(wait=False, cancel_futures=True)


@cache
def _engine(engine: str, precision: str, device: str | None) -> Engine:
    """Return the engine of this process."""
    return Engine(engine, precision=precision, device=device)


def _opened(engine: str, precision: str, device: str | None) -> None:
    """Open the engine of this process."""
    _engine(engine, precision, device)


def run_named(name: str, engine: str, precision: str, device: str | None) -> Row:
    """Run the case of that name in this process."""
    return run_case(by_name(name), _engine(engine, precision, device))


def run_case(case: Case, engine: Engine) -> Row:
    """Run a case on an engine, and compare."""
    begun = time.perf_counter()
    try:
        solved = case.solve(engine)
    except CnnumError as error:
        spent, sentence = time.perf_counter() - begun, str(error)
        passed = case.may_refuse(sentence)
        return _row(case, engine.name, engine.precision, "refused", spent, sentence, passed=passed)
    except Exception as error:  # the suite looks for raw errors
        spent, sentence = time.perf_counter() - begun, f"{type(error).__name__}: {error}"
        return _row(case, engine.name, engine.precision, "failed", spent, sentence)
    return _compared(case, engine, solved, time.perf_counter() - begun)


def _compared(case: Case, engine: Engine, solved: Solved, spent: float) -> Row:
    truth, allowed = case.truth(), case.allowed(engine.precision)
    error = inf
    if solved.values.shape == truth.shape and np.isfinite(solved.values).all():
        error = float(np.abs(solved.values - truth).max(initial=0.0))
    # an estimate says nothing of roundings of the truth's own size
    covered = error <= solved.estimate + 4.0 * np.finfo(engine.precision).eps * _size(truth)
    why = case.reason if covered else "The result states a smaller error than it has."
    return _row(
        case,
        engine.name,
        engine.precision,
        "solved",
        spent,
        why,
        error=error,
        estimate=solved.estimate,
        passed=bool(error <= allowed and covered),
    )


def _size(values: np.ndarray) -> float:
    return max(1.0, float(np.abs(values).max(initial=0.0)))


def _row(
    case: Case,
    engine: str,
    precision: str,
    outcome: Outcome,
    seconds: float,
    why: str,
    *,
    error: float = nan,
    estimate: float = nan,
    passed: bool = False,
) -> Row:
    stated = estimate if isfinite(estimate) else nan
    return Row(
        case.name,
        case.family,
        case.title,
        engine,
        precision,
        outcome,
        error,
        stated,
        case.allowed(precision),
        seconds,
        passed,
        why,
    )
