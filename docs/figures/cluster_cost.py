"""The cost of a Dask cluster in a sweep: `python docs/figures/cluster_cost.py`, a minute.

An empty task costs its way alone. The same sweep runs in this process, on one worker and on two,
once workers have their engines. The engine is Numba's, which keeps one core busy: on two cores two
workers can be twice as fast.
"""

import statistics
from dataclasses import replace
from functools import partial
from importlib import import_module
from typing import Any

from cnnum.design.experiment import Experiment
from cnnum.design.sweeping import Sweep, sweep
from cnnum.lab.bench.timing import seconds_of

RUNS, TASKS, TURNS, EMPTY = 128, 12, 3, 200
AXES = {"mismatch": (0.05,)}


def nothing(number: int) -> int:
    """Return the number: a task that costs nothing but its way."""
    return number


def once(experiment: Experiment, seed: int, address: str | None) -> Sweep:
    """Return a sweep with random numbers of its own, so that no cluster knows its results."""
    return sweep(replace(experiment, seed=seed), scheduler=address)


def way(client: Any) -> None:
    """Send empty tasks, and wait for all."""
    client.gather(client.map(nothing, range(EMPTY), pure=False))


def main() -> None:
    """Print the seconds of a task, of its way, and of all, by the number of workers."""
    distributed: Any = import_module("dask.distributed")
    draws = RUNS * TASKS
    experiment = Experiment("HOLE", AXES, draws, pictures=1, engine="numba", chunk=RUNS)
    made = once(experiment, 0, None)
    seconds: dict[int, list[float]] = {0: [], 1: [], 2: []}
    for workers in seconds:
        options = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": None}
        cluster = distributed.LocalCluster(**options) if workers else None
        address = cluster.scheduler_address if cluster else None
        once(experiment, 1000, address)  # workers open their engines
        for turn in range(TURNS):
            made = once(experiment, 1 + turn + 10 * workers, address)
            seconds[workers].append(made.seconds)
        if cluster:
            if workers == 1:
                with distributed.Client(cluster) as client:
                    each = [seconds_of(partial(way, client)) / EMPTY for _ in range(TURNS)]
                    print(f"an empty task: {1e3 * statistics.median(each):.1f} ms")
            cluster.close()
        print(f"{workers} workers: {statistics.median(seconds[workers]):.2f} s", flush=True)
    print(f"{made.tasks} tasks of {1e3 * made.task_seconds:.0f} ms")


if __name__ == "__main__":
    main()
