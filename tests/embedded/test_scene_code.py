"""The C of a scene's calibration and event rules, against what a scene itself runs."""

import shutil
import subprocess

import numpy as np
import pytest

import cnnum
from cnnum.embedded.c.files import identifier
from cnnum.embedded.c.text import record_type
from cnnum.embedded.making import real
from cnnum.frame import Frame
from cnnum.scenes.conversion import AsRead, ByArrayCalibration
from cnnum.scenes.events import EventDetector, EventRule
from cnnum.scenes.scene_code import with_scene
from cnnum.tactile.array_calibration import ArrayCalibration, CalibratedReader
from tests.embedded.conftest import STRICT

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")

SHAPE, AXES, RATE = (3, 4), ("shear_x", "shear_y", "normal"), 50.0


@cnnum.program
def signs(frame):
    most = frame.normal.max()
    numbers = {name: most * k for k, name in enumerate(("size", "row", "column", "x", "y"), 1)}
    turn = {"turn": frame.shear_x.max() - frame.shear_y.max()}
    flags = {name: most > k for k, name in enumerate(("up", "turns", "known"))}
    return {"map": frame.normal, "marks": frame.normal > 1.0, **numbers, **turn, **flags}


@pytest.fixture(scope="module")
def exports():
    frames = np.random.default_rng(0).uniform(-4.0, 4.0, (20, *SHAPE, 3))
    return {
        precision: cnnum.export(signs, like=frames, channels=AXES, precision=precision)
        for precision in ("q15", "float32")
    }


def compiled(exported, folder, main):
    exported.write(folder)
    (folder / "main.c").write_text(main)
    names = ["main.c", f"{identifier(exported.program.name)}.c"]
    command = ["cc", *STRICT, "-O1", "-fsanitize=undefined", "-fno-sanitize-recover=all", *names]
    done = subprocess.run(
        [*command, "-o", "main", "-lm"], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return folder / "main"


FOLLOWS = """#include "signs.h"
#include <stdio.h>
static signs_output output;
static signs_event_state state;
static signs_event events[SIGNS_EVENTS];
int main(void)
{
    uint8_t saturated;
    while (fread(&output, sizeof output, 1, stdin) == 1 && fread(&saturated, 1, 1, stdin) == 1) {
        const uint32_t count = signs_events(&state, &output, saturated, events);
        fwrite(&count, sizeof count, 1, stdout);
        fwrite(events, sizeof events[0], count, stdout);
    }
    return 0;
}
"""


def rules_of(rng):
    """Rules of every form: of maps and numbers, that are steady, of loads and shapes, that turn."""

    def pick(*choices):
        return choices[int(rng.integers(len(choices)))]

    result = []
    for n in range(8):
        on = float(rng.uniform(-1.0, 2.0))
        turns = pick("", "turns")
        result.append(
            EventRule(
                f"kind {n}",
                pick("map", "marks", "size", "up"),
                ends=pick("", f"end_{n}"),
                phase=pick("", "gross"),
                where=pick(None, ("row", "column")),
                direction=pick(None, ("x", "y")),
                strength=pick("", "size", "map"),
                sense=pick("", "turn"),
                load=pick(False, True),
                shape=pick(False, True),
                steady=pick(0.0, 0.05, 0.1),
                pivots=turns,
                centred=turns and pick("", "known"),
                on=on,
                off=on - pick(0.0, 0.8),
            )
        )
    return tuple(result)


def random_answers(program, count, rng):
    """Answers of a program as its structures hold them; numbers stay for four frames."""
    given = np.zeros(count, dtype=record_type(program.of_kind("output")))
    for array in program.of_kind("output"):
        values = rng.uniform(-3.0, 3.0, (count // 4, *given[array.name].shape[1:]))
        slow = np.repeat(values, 4, axis=0)
        places = 0 if array.format is None else array.format.fraction
        given[array.name] = slow > 0.0 if array.logic else np.ldexp(slow, places)
    return given


def said_by_c(rules, arrays, event):
    """What an event of C says, in the units of a scene."""
    begun = [f"{rule.phase}_{rule.kind}" if rule.phase else rule.kind for rule in rules]
    ends = [rule.ends for rule in rules]
    titles = dict.fromkeys(t for pair in zip(begun, ends, strict=True) for t in pair if t)
    title = list(titles)[event["kind"] - 1]
    rule = rules[(begun if title in begun else ends).index(title)]

    def value(output, field):
        return float(real(arrays[output], event[field].reshape(1))[0]) if output else event[field]

    place, way = (
        (value(o, f) for o, f in zip(rule.where or ("", ""), ("row", "column"), strict=True)),
        None,
    )
    if event["has_direction"]:
        x, y = (value(o, f) for o, f in zip(rule.direction, "xy", strict=True))
        way = round(np.arctan2(y, x), 12)
    return (
        title,
        tuple(map(float, place)) if event["has_place"] else None,
        way,
        value(rule.strength, "strength") if event["has_strength"] else None,
        event["sense"], bool(event["pivots"]), bool(event["is_bound"]),
    )  # fmt: skip


def said_by_scene(event):
    """The same of an event of a scene."""
    phased = event.phase and event.kind.startswith("kind")
    return (
        f"{event.phase}_{event.kind}" if phased else event.kind,
        event.where,
        None if event.direction is None else round(event.direction, 12),
        event.strength,
        event.sense or 0, event.motion == "pivot", event.load_is_bound,
    )  # fmt: skip


@pytest.mark.one_in(2)
@pytest.mark.parametrize("precision", ["q15", "float32"])
@pytest.mark.parametrize("seed", range(3))
def test_events_are_those_of_a_scene(exports, precision, seed, tmp_path):
    rng, count = np.random.default_rng(seed), 300
    rules, export = rules_of(rng), exports[precision]
    program, number = export.program, "<f4" if precision == "float32" else "<i4"
    arrays = {name: program.arrays[array] for name, array in program.outputs.items()}
    main = compiled(with_scene(export, AsRead(AXES), AXES, "count", rules, RATE), tmp_path, FOLLOWS)
    given = random_answers(program, count, rng)
    saturated = np.repeat(rng.random(count // 10) < 0.3, 10).astype(np.uint8)
    data = b"".join(a.tobytes() + b.tobytes() for a, b in zip(given, saturated, strict=True))
    said = subprocess.run([main], input=data, capture_output=True, check=True).stdout
    layout = np.dtype(
        [(name, number) for name in ("row", "column", "x", "y", "strength")]
        + [(name, "u1") for name in ("kind", "has_place", "has_direction", "has_strength")]
        + [("pivots", "u1"), ("is_bound", "u1"), ("sense", "i1")],
        align=True,
    )
    detector, at, total = EventDetector(rules), 0, 0
    for n, answer in enumerate(given):
        known = {}
        for name, array in arrays.items():
            values = real(array, answer[array.name])
            known[name] = values.reshape(SHAPE) if array.length else values[0]
        wanted = detector.update(n / RATE, n, known, saturated=bool(saturated[n]))
        (many,) = np.frombuffer(said, "<u4", 1, at)
        events = np.frombuffer(said, layout, int(many), at + 4)
        assert [said_by_c(rules, arrays, event) for event in events] == list(
            map(said_by_scene, wanted)
        )
        at, total = at + 4 + events.nbytes, total + len(wanted)
    assert at == len(said)
    assert total >= 10


READS = """#include "signs.h"
#include <stdio.h>
static NUMBER raw[SIGNS_ROWS * SIGNS_COLS * SIGNS_CHANNELS];
static signs_input input;
TARE
int main(void)
{
    while (fread(raw, sizeof raw, 1, stdin) == 1) {
        const uint32_t beyond = signs_calibrate(GIVEN raw, &input);
        fwrite(&beyond, sizeof beyond, 1, stdout);
        fwrite(&input, sizeof input, 1, stdout);
    }
    return 0;
}
"""


@pytest.mark.one_in(3)
@pytest.mark.parametrize("precision", ["q15", "float32"])
@pytest.mark.parametrize(
    ("gain", "offset", "tare"),
    [((), (), 0), ((3,), (3,), 0), ((*SHAPE, 3), (), 7), ((3, 3), (*SHAPE, 3), 0),
     ((*SHAPE, 3, 3), (*SHAPE, 3), 0), ((3, 3), (), 5)],
)  # fmt: skip
def test_calibrated_frames_are_those_of_a_scene(exports, precision, gain, offset, tare, tmp_path):
    """To a rounding: at most one step of an input away, and as many beyond its ends."""
    rng = np.random.default_rng(len(gain) * 10 + tare)
    scale = ArrayCalibration(
        rng.uniform(-1.0, 1.0, gain) * 2e-3, rng.uniform(500.0, 3000.0, offset), "N", tare
    )
    export = exports[precision]
    conversion = ByArrayCalibration(scale, SHAPE, AXES)
    code = with_scene(export, conversion, AXES, "count", (), RATE)
    whole = precision == "q15"
    text = READS.replace("NUMBER", "int32_t" if whole else "float")
    text = text.replace("TARE", "static signs_tare tare;" if tare else "")
    main = compiled(code, tmp_path, text.replace("GIVEN", "&tare," if tare else ""))
    frames = rng.integers(-5_000, 9_000, (40, *SHAPE, 3))
    data = frames.astype("<i4" if whole else "<f4").tobytes()
    said = subprocess.run([main], input=data, capture_output=True, check=True).stdout
    inputs = export.program.of_kind("input")
    layout = np.dtype([("beyond", "<u4"), ("in", record_type(inputs))])
    found = np.frombuffer(said, layout)
    reader = CalibratedReader(scale, SHAPE, AXES, AXES)
    outside = 0
    for n, raw in enumerate(frames.astype(np.float64)):
        wanted = reader(Frame(raw, AXES, "count", n, n / RATE))
        for array in inputs:
            axis = AXES.index(array.name.removeprefix("in_"))
            exact = wanted[..., axis].ravel()
            ours = found["in"][array.name][n]
            if whole:
                steps = np.ldexp(exact, array.format.fraction)
                limited = np.clip(steps, array.format.least, array.format.largest)
                outside += int((np.abs(steps - limited) > 1.0).sum())
                # a half by rounding, and a half by gains of 24 bits times numbers of 16
                assert np.abs(ours - limited).max() <= 1.0
            else:
                np.testing.assert_allclose(ours, exact, rtol=1e-5, atol=1e-4)
    if whole:
        assert 0 <= int(found["beyond"].sum()) - outside <= 0.01 * frames.size
