"""The peers on the same work to the same measured error as this engine."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, digest
from cnnum.engine import Engine
from cnnum.errors import MissingExtraError
from cnnum.lab.bench.peers import PEERS, Peer, Work, peer_version
from cnnum.lab.bench.samples import full_template, generator
from cnnum.lab.bench.timing import interleaved
from cnnum.runs.result import Result
from cnnum.templating.library import get_template

TRIAL_STEP = 0.02
"""Euler's error is proportional to the step, so one trial gives the step that meets an error."""

TOLERANCES = tuple(10.0**-n for n in range(2, 11))
WITHIN = tuple(10.0 ** (n / 4) for n in (3, 2, 1))
"""Looser ones within the decade before the first that meets an error, the loosest first."""


@dataclass(frozen=True, slots=True)
class PeerRun:
    """A row of `cnnum bench peers`.

    Attributes
    ----------
    case, peer, peer_version, device : str
    peer_method, method : str
        How each steps.
    peer_seconds, seconds : float
        Medians, array to array, s.
    ratio : float
        Theirs over ours.
    peer_error, error : float
        Largest error of the state over its largest value, against the reference engine.
    spread : float
        Spread of our time, s.
    """

    case: str
    peer: str
    peer_version: str
    device: str
    peer_method: str
    method: str
    peer_seconds: float
    seconds: float
    ratio: float
    peer_error: float
    error: float
    spread: float


@dataclass(frozen=True, slots=True, eq=False)
class Race:
    """A case: the work, and how both sides may do it.

    Attributes
    ----------
    name : str
    work : Work
    wanted : float or None
        Relative error to be met by the quickest method; None runs the same Euler steps.
    pictures : int
        Frames of the work; a peer takes them one by one.
    """

    name: str
    work: Work
    wanted: float | None = None
    pictures: int = 1


def races() -> tuple[Race, ...]:
    """Return the cases."""
    small, large, single = (8, 8), (1024, 1024), np.dtype(np.float32)
    full = full_template()

    def euler(shape: tuple[int, int], steps: int, step: float = 0.01) -> Work:
        rng = generator()
        start, given = rng.uniform(-1.0, 1.0, shape), rng.uniform(-1.0, 1.0, shape)
        return Work(full, start, given, steps * step, step, 1e-3, single)

    diffusion = get_template("tactile_diffusion")
    gray = generator().uniform(-1.0, 1.0, small)
    heat = Work(diffusion, gray, np.zeros(small), 1.0, 0.1, 1e-5, np.dtype(np.float64))
    return (
        Race("8×8, 200 Euler steps", euler(small, 200)),
        Race("1024×1024, 100 Euler steps", euler(large, 100)),
        Race("1024×1024, 1000 Euler steps", euler(large, 1000, 0.001)),
        Race("diffusion 8×8×3 to 1e-5", heat, wanted=1e-5, pictures=3),
    )


def measure_peers(engine: Engine, *, quick: bool = False) -> Iterator[PeerRun | str]:
    """Yield one row per case and peer, or a sentence where a peer is missing or left out."""
    truths: dict[str, Floats] = {}
    for race in races():
        work = race.work
        key = digest(work.template.digest, work.start, work.input, work.duration)
        if key not in truths:
            truths[key] = _truth(work)
        truth = truths[key]
        own, method = _own(engine, race)
        for peer in PEERS:
            large = work.start.size > 10_000
            if quick and large and peer.slow:
                yield f"{peer.name} on '{race.name}': takes seconds a run, left out by --quick"
                continue
            try:
                yield _race(engine, race, truth, own, method, peer, quick)
            except MissingExtraError as error:
                yield str(error)
        if race.wanted is not None:
            yield _against_euler(engine, race, truth, own, method)


def _truth(work: Work) -> Floats:
    result = Engine("reference").run(
        work.template,
        duration=work.duration,
        **_maps(work),  # type: ignore[arg-type]
    )
    return result.state


def _maps(work: Work) -> dict[str, Floats]:
    return {"state": work.start} | ({"input": work.input} if work.template.inputs else {})


def _error(state: NDArray[np.floating], truth: Floats) -> float:
    return float(np.abs(state - truth).max() / np.abs(truth).max())


def _own(engine: Engine, race: Race) -> tuple[Callable[[], Floats], str]:
    work = race.work
    given = {
        name: np.stack([values] * race.pictures) if race.pictures > 1 else values
        for name, values in _maps(work).items()
    }
    tolerance = 1e-4 if race.wanted is None else 0.1 * race.wanted
    step = work.step if race.wanted is None else None

    def once() -> Result:
        return engine.run(
            work.template,
            input=given.get("input"),
            state=given["state"],
            duration=work.duration,
            dt=step,
            rtol=tolerance,
            atol=tolerance,
        )

    def run() -> Floats:
        return once().state

    return run, once().method


def _race(
    engine: Engine,
    race: Race,
    truth: Floats,
    own: Callable[[], Floats],
    method: str,
    peer: Peer,
    quick: bool,
) -> PeerRun:
    run = peer.load()
    work = _sharpened(race, truth, peer, run)
    # a peer that compiles does so now, not while it is timed
    run(work if peer.whole else replace(work, duration=2.0 * work.step))

    def theirs() -> NDArray[np.floating]:
        for _ in range(race.pictures - 1):
            run(work)
        return run(work)

    them, us = interleaved([theirs, own], budget=1.0 if quick else 5.0, runs=15)
    step = f"Euler, dt {work.step:.3g}" if peer.fixed else f"vode, rtol {work.tolerance:g}"
    return PeerRun(
        case=race.name,
        peer=peer.name,
        peer_version=peer_version(peer),
        device=engine.device,
        peer_method=step,
        method=method,
        peer_seconds=them.median,
        seconds=us.median,
        ratio=them.median / us.median,
        peer_error=_error(run(work), truth),
        error=_error(own().reshape(-1, *truth.shape)[0], truth),
        spread=us.spread,
    )


def _sharpened(race: Race, truth: Floats, peer: Peer, run: Callable[[Work], object]) -> Work:
    """Return the work with the longest step, or the loosest tolerance, that meets the error."""
    work = race.work
    if peer.fixed:
        return work if race.wanted is None else replace(work, step=_step(race, truth))
    goal = race.wanted or _error(_euler_state(work), truth)

    def meets(tolerance: float) -> bool:
        return _error(np.asarray(run(replace(work, tolerance=tolerance))), truth) <= goal

    met = next((candidate for candidate in TOLERANCES if meets(candidate)), TOLERANCES[-1])
    looser = next((candidate * met for candidate in WITHIN if meets(candidate * met)), met)
    return replace(work, tolerance=looser)


def _step(race: Race, truth: Floats) -> float:
    """Return the Euler step, a whole part of the duration, whose error is the one wanted."""
    trial = replace(race.work, step=TRIAL_STEP)
    longest = TRIAL_STEP * 0.98 * (race.wanted or 0.0) / _error(_euler_state(trial), truth)
    return race.work.duration / math.ceil(race.work.duration / longest)


def _euler_state(work: Work) -> Floats:
    """Return where the fixed steps of the work lead, whoever takes them."""
    engine = Engine("reference")
    return engine.run(
        work.template,
        duration=work.duration,
        dt=work.step,
        **_maps(work),  # type: ignore[arg-type]
    ).state


def _against_euler(
    engine: Engine, race: Race, truth: Floats, own: Callable[[], Floats], method: str
) -> PeerRun:
    """Race this engine's chosen method against its own Euler steps at the same error."""
    double = engine.with_precision("float64")
    work = race.work

    def euler(step: float) -> Callable[[], Floats]:
        given = {name: np.stack([m] * race.pictures) for name, m in _maps(work).items()}
        return lambda: double.run(work.template, **given, duration=work.duration, dt=step).state  # type: ignore[arg-type]

    step = _step(race, truth)
    them, us = interleaved([euler(step), own], budget=2.0, runs=15)
    return PeerRun(
        case=race.name,
        peer="this engine's Euler",
        peer_version="",
        device=engine.device,
        peer_method=f"Euler, dt {step:.3g}, float64",
        method=method,
        peer_seconds=them.median,
        seconds=us.median,
        ratio=them.median / us.median,
        peer_error=_error(euler(step)()[0], truth),
        error=_error(own().reshape(-1, *truth.shape)[0], truth),
        spread=us.spread,
    )
