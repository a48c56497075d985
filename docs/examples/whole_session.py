"""Templates, a program, a scene, a recording and a worker process, with every type checked.

`mypy --strict` and pyright's strict mode accept this script: all names come from `cnnum` itself.
"""

from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import cnnum


@cnnum.program
def touch(frame: cnnum.FrameFields, threshold: float = 0.1) -> Mapping[str, cnnum.Field]:
    """Say whether anything is pressed harder than a threshold, and outline it."""
    pressed = frame.normal > threshold
    outline = cnnum.apply("EDGE", input=pressed.picture())
    return {"contact": pressed.any(), "outline": outline.black()}


def count_contacts(program: cnnum.Program, recording: cnnum.Recording) -> int:
    """Run a program over a recording: in a worker, which makes an engine of its own."""
    plan = cnnum.Engine("reference").compile(program, recording.shape, needs=["contact"])
    with plan.stream() as stream:
        return sum(bool(stream.push(frame.values)["contact"]) for frame in recording.frames())


def main() -> None:
    """Go once through everything."""
    leak = cnnum.Template(name="leak", A=[[0.5]], B=[[1.0]], duration=3.0)
    result = cnnum.Engine("reference").run(leak, input=np.full((4, 4), 0.3))
    # x' = -x + 0.5 x + 0.3 from 0, so x(3) = 0.6 (1 - exp(-1.5))
    print(f"{leak.name}: {result.state[0, 0]:.6f}, exact {0.6 * (1 - np.exp(-1.5)):.6f}")

    values = np.zeros((100, 8, 8, 3))
    values[40:70, 3:5, 3:6, 2] = 1.0
    recording = cnnum.Recording(values, rate=100.0, unit="N")
    with TemporaryDirectory() as folder:
        path = recording.save(Path(folder) / "press.npz")
        again = cnnum.load_recording(path)
    print(f"read again: {again}, the same: {again == recording}")

    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        count = pool.submit(count_contacts, touch.bind(threshold=0.5), recording).result()
    print(f"frames with a contact, counted in a worker: {count}")

    with cnnum.get_scene("contact") as scene:
        record = scene.collect(frames=120)
        first: cnnum.Event = record.events[0]
    print(f"{scene}\n{len(record)} frames, first event: {first.kind} at {first.time:.2f} s")


if __name__ == "__main__":
    main()
