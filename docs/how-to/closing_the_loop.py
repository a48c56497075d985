"""A gripper that holds what slips: 16 fingertips and a palm at 1 kHz, and a controller.

    python docs/how-to/closing_the_loop.py --seconds 300 --controller thread

The controller is a thread, a coroutine (`asyncio`) or another process (`process`), which reads the
newest state in shared memory. The hand is simulated, and its frames are worked out before: a real
one has a reader that hands over each packet in the same way.
"""

import argparse
import asyncio
import gc
import json
import multiprocessing
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

import numpy as np

import cnnum

HAND = """
needs = ["contact", "slip", "twist"]
[array]
driver = "simulated"
shape = [4, 4]
rate = {rate}
script = [
    {{kind = "hold", duration = 0.5}},
    {{kind = "press", duration = 0.4, load = 0.3}},
    {{kind = "pull", duration = 0.6, speed = 2e-3, direction = 0.3}},
    {{kind = "twist", duration = 0.4, angle = 0.5}},
    {{kind = "release", duration = 0.3}},
    {{kind = "hold", duration = 0.3}},
]
[program.parameters]
depth = 0.667
unit = 1.305
{fingers}
[skin.palm.array]
shape = [16, 16]
"""

STATE = np.dtype([("begun", "u8"), ("ended", "u8"), ("time_ns", "i8"), ("force", "f8")])
"""What the controller's process reads: where both numbers are equal, nothing was being written."""


def hand_of(fingers: int, rate: float) -> cnnum.Hand:
    """Return a simulated hand."""
    tables = "".join(f"[skin.finger_{n}.array]\nseed = {n % 4}\n" for n in range(fingers))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "hand.toml")
        path.write_text(HAND.format(rate=rate, fingers=tables))
        return cnnum.load_hand(path, deadline=1.0 / rate)


def packets(
    hand: cnnum.Hand, rate: float, seconds: float, speed: float = 1.0
) -> Iterator[dict[str, cnnum.Frame]]:
    """Yield the frames of all skins, each step when it is due: grasp after grasp."""
    known: dict[object, list[cnnum.Frame]] = {}
    grasps: dict[str, list[cnnum.Frame]] = {}
    for name, scene in hand.skins.items():  # skins of one seed feel the same
        key = (scene.shape, scene.spec.driver_options.get("seed"))
        if key not in known:
            known[key] = list(scene.driver.frames())
        grasps[name] = known[key]
    yield {name: replace(frames[-1], time=0.0) for name, frames in grasps.items()}
    begin = time.monotonic_ns() + 10_000_000
    for number in range(1, int(seconds * rate * speed)):
        due = begin + int(1e9 * number / (rate * speed))
        time.sleep(max(0.0, 1e-9 * (due - time.monotonic_ns())))
        yield {
            name: replace(
                frames[number % len(frames)], sequence=number, time=number / rate, monotonic_ns=due
            )
            for name, frames in grasps.items()
        }


class Gripper:
    """Grips more firmly where something slips or turns, and lets go where nothing is held."""

    def __init__(self) -> None:
        self.force, self.slips, self.held = 0.0, 0, set[str]()

    def __call__(self, step: cnnum.HandResult) -> float:
        """Return the force after a step."""
        for skin, event in step.events:
            if event.kind == "contact":
                self.held.add(skin)
            elif event.kind == "release":
                self.held.discard(skin)
            elif event.kind in ("slip", "twist"):
                self.slips += 1
                self.force *= 1.05
        self.force = max(self.force, 1.0) if self.held else 0.0
        return self.force


def in_thread(hand: cnnum.Hand, steps: Iterator[dict[str, cnnum.Frame]]) -> Gripper:
    """Let the controller run in the thread that processes the hand."""
    gripper = Gripper()

    def work() -> None:
        for frames in steps:
            gripper(hand.push(frames))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    return gripper


def in_coroutine(hand: cnnum.Hand, steps: Iterator[dict[str, cnnum.Frame]]) -> Gripper:
    """Let the controller be a coroutine, while a thread waits for packets and processes them."""
    gripper = Gripper()

    def next_step() -> cnnum.HandResult | None:
        frames = next(steps, None)
        return None if frames is None else hand.push(frames)

    async def control() -> None:
        while (step := await asyncio.to_thread(next_step)) is not None:
            gripper(step)

    asyncio.run(control())
    return gripper


def in_process(hand: cnnum.Hand, steps: Iterator[dict[str, cnnum.Frame]]) -> Gripper:
    """Let the controller's process read the newest state in shared memory."""
    gripper, context = Gripper(), multiprocessing.get_context("spawn")
    memory = SharedMemory(create=True, size=STATE.itemsize)
    done, ages = context.Event(), context.SimpleQueue()
    reader = context.Process(target=control, args=(memory.name, done, ages))
    reader.start()
    ages.get()  # it has begun
    state = np.ndarray((), STATE, memory.buf)
    state[...] = 0
    for number, frames in enumerate(steps, 1):
        step = hand.push(frames)
        state["begun"] = number
        state["time_ns"] = frames["palm"].monotonic_ns
        state["force"] = gripper(step)
        state["ended"] = number
    done.set()
    age, seen = ages.get()
    reader.join()
    del state
    memory.close()
    memory.unlink()
    print(json.dumps({"process_p50_us": age[0], "process_p99_us": age[1], "states_seen": seen}))
    return gripper


def control(name: str, done: threading.Event, ages: "multiprocessing.SimpleQueue[object]") -> None:
    """Follow the newest state, and note its age when it is seen first."""
    memory, last = SharedMemory(name), 0
    seen: list[float] = []
    state = np.ndarray((), STATE, memory.buf)
    ages.put(None)
    while not done.is_set():
        ended = int(state["ended"])
        copy = state.copy()
        if ended != last and copy["begun"] == ended:
            seen.append(1e-3 * (time.monotonic_ns() - int(copy["time_ns"])))
            last = ended
        time.sleep(1e-4)
    ages.put(([round(x, 1) for x in np.quantile(seen or [0.0], (0.5, 0.99))], len(seen)))
    del state
    memory.close()


CONTROLLERS = {"thread": in_thread, "asyncio": in_coroutine, "process": in_process}


def main() -> None:
    """Run a hand with a controller, and print what was measured as one JSON object."""
    parser = argparse.ArgumentParser(description="A controller on a simulated hand.")
    parser.add_argument("--controller", choices=CONTROLLERS, default="thread")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--speed", type=float, default=1.0, help="1 is real time")
    parser.add_argument("--fingers", type=int, default=16)
    wanted = parser.parse_args()
    hand = hand_of(wanted.fingers, wanted.rate)
    hand.warm_up()
    steps = packets(hand, wanted.rate, wanted.seconds, wanted.speed)
    first = next(steps)
    hand.push(first)
    gc.collect()
    gc.freeze()  # what is there by now stays, and is looked at no more
    begun = time.process_time()
    gripper = CONTROLLERS[wanted.controller](hand, steps)
    spent = time.process_time() - begun
    done = hand.summary()
    due = int(wanted.seconds * wanted.rate * wanted.speed) * len(hand)  # whether it came or not
    lost = due - sum(s.handed_on for s in done.skins.values())
    print(
        json.dumps(
            {
                "controller": wanted.controller,
                "steps": done.steps,
                "frames": sum(s.frames for s in done.skins.values()),
                "frames_lost": lost,
                "missed_ticks": done.missed,
                "p50_us": round(done.p50_us, 1),
                "p99_us": round(done.p99_us, 1),
                "processor_us_a_step": round(1e6 * spent / (done.steps - 1), 1),
                "slips_and_twists": gripper.slips,
            }
        )
    )


if __name__ == "__main__":
    main()
