"""The C of a scene's calibration and event rules, against what a scene itself runs."""

import shutil
import subprocess

import numpy as np
import pytest

import cnnum
from cnnum.embedded.c.files import identifier
from cnnum.embedded.c.program import record_type
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


@pytest.mark.one_in(2)
@pytest.mark.parametrize("precision", ["q15", "float32"])
@pytest.mark.parametrize("seed", range(3))
def test_events_are_those_of_a_scene(exports, precision, seed, tmp_path):
    rng = np.random.default_rng(seed)
    rules = rules_of(rng)
    export = exports[precision]
    code = with_scene(export, AsRead(AXES), AXES, "count", rules, RATE)
    main = compiled(code, tmp_path, FOLLOWS)
    outputs = export.program.of_kind("output")
    layout = record_type(outputs)
    count, given = 300, np.zeros(300, dtype=layout)
    for array in outputs:
        size = given[array.name].shape
        if array.logic:
            given[array.name] = rng.random(size) < 0.5
            continue
        slow = np.repeat(rng.uniform(-3.0, 3.0, (count // 4, *size[1:])), 4, axis=0)
        places = 0 if array.format is None else array.format.fraction
        given[array.name] = np.ldexp(slow, places)
    saturated = np.repeat(rng.random(count // 10) < 0.3, 10).astype(np.uint8)
    data = b"".join(
        given[n : n + 1].tobytes() + saturated[n : n + 1].tobytes() for n in range(count)
    )
    said = subprocess.run([main], input=data, capture_output=True, check=True).stdout

    number = "<f4" if precision == "float32" else "<i4"
    kinds = {
        name: n
        for n, name in enumerate(
            dict.fromkeys(
                t
                for r in rules
                for t in ((f"{r.phase}_{r.kind}" if r.phase else r.kind), r.ends)
                if t
            ),
            1,
        )
    }
    event_type = np.dtype(
        [
            *((name, number) for name in ("row", "column", "x", "y", "strength")),
            *((name, "u1") for name in ("kind", "place", "direction", "strong", "pivots", "bound")),
            ("sense", "i1"),
        ],
        align=True,
    )
    names = {array: name for name, array in export.program.outputs.items()}
    detector, at, total = EventDetector(rules), 0, 0

    def value(output, raw):
        array = export.program.arrays[export.program.outputs[output]]
        return float(real(array, np.asarray([raw]))[0])

    for n in range(count):
        known = {}
        for array in outputs:
            numbers = real(array, given[array.name][n : n + 1].astype(np.float64))[0]
            known[names[array.name]] = numbers.reshape(SHAPE) if array.length else numbers[0]
        wanted = detector.update(n / RATE, n, known, saturated=bool(saturated[n]))
        (many,) = np.frombuffer(said, "<u4", 1, at)
        found = np.frombuffer(said, event_type, int(many), at + 4)
        at += 4 + found.nbytes
        assert len(found) == len(wanted), n
        total += len(wanted)
        for event, ours in zip(wanted, found, strict=True):
            title = (
                f"{event.phase}_{event.kind}"
                if event.kind.startswith("kind") and event.phase
                else event.kind
            )
            assert kinds[title] == ours["kind"]
            rule = next(r for r in rules if event.kind in (r.kind, r.ends))
            assert bool(ours["place"]) == (event.where is not None)
            if event.where is not None:
                own = (ours["row"], ours["column"])
                if rule.where:
                    own = tuple(value(o, raw) for o, raw in zip(rule.where, own, strict=True))
                assert tuple(map(float, own)) == event.where
            assert bool(ours["direction"]) == (event.direction is not None)
            if event.direction is not None:
                x, y = (
                    value(o, raw)
                    for o, raw in zip(rule.direction, (ours["x"], ours["y"]), strict=True)
                )
                assert np.arctan2(y, x) == pytest.approx(event.direction, abs=1e-12)
            assert bool(ours["strong"]) == (event.strength is not None)
            if event.strength is not None:
                assert value(rule.strength, ours["strength"]) == event.strength
            assert ours["sense"] == (event.sense or 0)
            assert bool(ours["pivots"]) == (event.motion == "pivot")
            assert bool(ours["bound"]) == event.load_is_bound
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
