"""One's own program, at one's own rate, with ranges of one's own frames, as C99 that runs."""

import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import cnnum
from cnnum.cli import main
from cnnum.errors import ArrayError, ProgramError, UnknownNameError
from cnnum.programs.fields import maximum, minimum, sqrt, where

needs_cc = pytest.mark.skipif(
    shutil.which("cc") is None or shutil.which("make") is None, reason="no C compiler"
)


@cnnum.program
def follows(frame, *, rate: float = 200.0):
    """A memory that comes after the load with a time constant of 50 ms."""
    past = frame.memory("past")
    share = float(np.exp(-1.0 / (0.05 * rate)))
    now = share * past.value + (1.0 - share) * frame.normal
    past.store(now)
    return {"late": now, "most": now.max()}


def frames(count=200, seed=0):
    """Loads up to 40 units that come and go, (frames, 3, 4, 1): no array has such strain."""
    rng = np.random.default_rng(seed)
    times = np.arange(count)[:, None, None, None] / 30.0
    return 20.0 * (1.0 + np.sin(times + rng.uniform(0, 6, (1, 3, 4, 1))))


@needs_cc
@pytest.mark.parametrize(("rate", "precision"), [(60.0, "q15"), (1000.0, "float32")])
def test_the_c_is_the_program_at_that_rate(tmp_path, rate, precision):
    recording = cnnum.Recording(frames()[..., 0], rate=rate, unit="N", channels=("normal",))
    exported = cnnum.export(follows, precision=precision, like=recording)
    exported.write(tmp_path)
    subprocess.run(["make", "check", "stream"], cwd=tmp_path, check=True, capture_output=True)
    header = (tmp_path / "follows.h").read_text()
    assert f"#define FOLLOWS_RATE_HZ {rate:g}" in header
    assert "in_normal, N: " in header
    assert 'extern "C"' in header
    shown = frames(seed=1)
    if precision == "q15":
        fraction = int(header.split("FOLLOWS_IN_NORMAL_FRACTION ")[1].split()[0])
        given = np.round(shown * 2.0**fraction).astype("<i2")
    else:
        given = shown.astype("<f4")
    ran = subprocess.run(
        ["./stream"], cwd=tmp_path, input=given.tobytes(), capture_output=True, check=True
    )
    wanted = np.zeros((3, 4))
    share = np.exp(-1.0 / (0.05 * rate))
    steps = []
    for frame in shown[..., 0]:
        wanted = share * wanted + (1.0 - share) * frame
        steps.append(wanted)
    scale = 0 if precision == "float32" else -1
    kind = "<f4" if precision == "float32" else "<i2"
    at = header.index("} follows_output")
    order = [line.split()[1] for line in header[:at].splitlines() if " out_" in line]
    size = len(ran.stdout) // len(shown)
    rows = np.frombuffer(ran.stdout, np.uint8).reshape(len(shown), size)
    start = 4 if order[0].startswith("out_most") else 0
    maps = rows[:, start : start + 12 * np.dtype(kind).itemsize].copy().view(kind)
    if scale:
        fraction = int(header.split("FOLLOWS_OUT_LATE_FRACTION ")[1].split()[0])
        maps = maps * 2.0**-fraction
    # sixteen bits of a range up to twice the largest value, with a memory that sums their rounding
    bound = 40 * 2.0**-14 * 8 if scale else 1e-4
    np.testing.assert_allclose(maps.reshape(-1, 3, 4), steps, atol=bound)


def test_a_rate_that_is_bound_stays():
    bound = follows.bind(rate=25.0)
    assert cnnum.export(bound, like=frames()).facts.rate == 25.0
    assert cnnum.export(follows, like=frames(), rate=500).facts.rate == 500.0
    assert cnnum.export(follows, like=frames()).facts.rate == 200.0


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        ({"channels": ("pressure",)}, UnknownNameError, "Give frames"),
        ({"like": frames()[:0]}, ArrayError, "at least one"),
        ({"like": np.full((5, 3, 4, 1), np.nan)}, ArrayError, "finite"),
        ({"like": frames(), "shape": (8, 8)}, ArrayError, "3×4"),
        ({"like": frames(), "rate": -1.0}, ArrayError, "above 0"),
        ({"like": cnnum.Recording(frames()[..., 0], rate=10), "channels": ("x",)},
         UnknownNameError, "x"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_one_sentence(given, error, words):
    with pytest.raises(error, match=words):
        cnnum.export(follows, **given)


def test_a_function_that_is_no_program_is_one_sentence():
    with pytest.raises(ProgramError, match="'program' must be of the type Program, got function"):
        cnnum.export(lambda frame: {"a": frame.normal})


@needs_cc
def test_the_command_takes_files_and_scenes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    source = "import numpy as np\nimport cnnum\n\n\n@cnnum.program\ndef most(frame):\n"
    (tmp_path / "own.py").write_text(source + '    return {"most": (-frame.normal).max()}\n')
    loads = -1e-3 * frames(60)[..., 0]
    cnnum.Recording(loads, rate=80, unit="strain", channels=("normal",)).save("like.npz")
    scene = '[array]\ndriver = "npz"\npath = "like.npz"\n[program]\nname = "own.py:most"\n'
    (tmp_path / "scene.toml").write_text(scene + '[[event]]\nkind = "hit"\nflag = "most"\n')
    for options in (
        ["own.py:most", "--like", "like.npz"],
        ["--scene", "scene.toml", "--trust"],
    ):
        done = CliRunner().invoke(main, ["export", *options, "--out", "c", "--force"])
        assert done.exit_code == 0, done.output
        header = (tmp_path / "c" / "most.h").read_text()
        assert "in_normal, strain" in header
        assert ("#define MOST_EVENT_HIT 1" in header) == ("--scene" in options)
        assert ("most_calibrate(const int32_t *raw" in header) == ("--scene" in options)
        # the C of the scene is compiled here, and its numbers are held in test_scene_code.py
        subprocess.run(["make", "vector"], cwd=tmp_path / "c", check=True, capture_output=True)
    for options in ([], ["own.py:most", "--scene", "scene.toml"]):
        refused = CliRunner().invoke(main, ["export", *options, "--out", "d"])
        assert refused.exit_code == 2
        assert not (tmp_path / "d").exists()


def rest_of(frame):
    return frame.memory("rest").mean(frame.normal, 0.25)


def both_of_them(frame):
    rest = frame.once(rest_of)
    return rest, cnnum.apply(cnnum.get_template("DIFFUS"), state=frame.normal - rest, duration=0.5)


@cnnum.program
def rises(frame):
    rest, smooth = both_of_them(frame)
    edge = cnnum.apply(cnnum.get_template("EDGE"), input=smooth, duration=3.0)
    return {"rest": rest, "most": smooth.max(), "rim": edge}


@cnnum.program
def falls(frame):
    rest, smooth = both_of_them(frame)
    wide = cnnum.apply(cnnum.get_template("DIFFUS"), state=-smooth, duration=2.0)
    return {"rest": rest, "most": wide.max(), "wide": wide, "fell": frame.normal.max() < 1.0}


@needs_cc
@pytest.mark.one_in(2)
@pytest.mark.parametrize("method", ["euler", "auto"])
def test_several_programs_are_one_with_one_memory_to_work_in(tmp_path, method):
    """Its numbers are those of the programs alone, and it takes less memory than they together."""
    rng = np.random.default_rng(3)
    given, shown = (np.cumsum(rng.normal(0.0, 0.5, (24, 4, 5, 1)), axis=0) for _ in range(2))
    alone = {p.name: cnnum.export(p, like=given, method=method) for p in (rises, falls)}
    joined = cnnum.export([rises, falls], like=given, method=method)
    assert joined.memory_bytes < 0.7 * sum(one.memory_bytes for one in alone.values())
    compact = cnnum.export(rises, like=given, method=method, share_memory=True)
    assert compact.memory_bytes < alone["rises"].memory_bytes
    results = {}
    for name, one in {**alone, "joined": joined, "compact": compact}.items():
        one.write(tmp_path / name)
        results[name] = cnnum.load_export(tmp_path / name).run(shown)
    names = {"rest", "rises_most", "falls_most", "rim", "wide", "fell"}
    assert set(results["joined"]) == names
    for name in ("rises", "falls"):
        for key, values in results[name].items():
            found = results["joined"][f"{name}_most" if key == "most" else key]
            np.testing.assert_array_equal(found, values, key)
            assert np.ptp(values) > 0
    for key, values in results["rises"].items():
        np.testing.assert_array_equal(results["compact"][key], values)


def test_no_output_of_several_programs_is_lost():
    """One that would have the name of another is refused, and so is a program named twice."""

    def outputs(name, **factors):
        return cnnum.Program(lambda frame: {k: frame.normal * f for k, f in factors.items()}, name)

    given = np.ones((4, 3, 4, 1))
    with pytest.raises(ProgramError, match="'first' is named twice"):
        cnnum.export([outputs("first", x=2.0), outputs("first", x=3.0)], like=given)
    both = [outputs("first", x=2.0), outputs("second", x=3.0, first_x=4.0)]
    with pytest.raises(ProgramError, match="Two outputs would be named 'first_x'"):
        cnnum.export(both, like=given)


def shares(floor, divides, lowest, largest):
    """A share of the largest load that is limited, as maps divided by a number or by a map."""

    @cnnum.program
    def limited(frame):
        load = frame.normal
        top = maximum(load.max(), floor)
        if divides == "inverse":
            share = minimum(maximum(1.0 / top, lowest), largest)
        elif divides == "map":
            share = maximum(minimum(load / maximum(abs(load), floor), largest), lowest)
        else:
            share = minimum(maximum(0.5 * load / top, lowest), largest)
        return {"share": share}

    return limited


@pytest.mark.parametrize("divides", ["number", "inverse", "map"])
@pytest.mark.parametrize("scale", [1e-4, 1.0, 3e3])
@pytest.mark.parametrize("floor", [1e-30, 1e-9])
def test_a_quotient_that_is_limited_needs_no_range_for_frames_without_a_load(floor, scale, divides):
    """Such frames divide by next to nothing; a range for that left no bits for all others."""
    lowest, largest = (0.0, 5.0 / scale) if divides == "inverse" else (-1.0, 1.0)
    limited = shares(floor, divides, lowest, largest)
    random = np.random.default_rng(7)
    loads = scale * random.uniform(0.25, 1.0, (300, 3, 4, 1))
    loads[::50] *= -0.01  # nothing pushes: the top is the floor
    engine = cnnum.Engine("reference", precision="q15")
    stream = engine.compile(limited, (3, 4), channels=("normal",), like=loads).stream()
    given = np.stack([stream.push(frame)["share"] for frame in loads])
    tops = np.maximum(loads[..., 0].max(axis=(1, 2)), floor)
    if divides == "inverse":
        wanted = np.clip(1.0 / tops, lowest, largest)
    else:
        below = (
            np.maximum(np.abs(loads[..., 0]), floor) if divides == "map" else tops[:, None, None]
        )
        wanted = np.clip((1.0 if divides == "map" else 0.5) * loads[..., 0] / below, -1.0, 1.0)
    # a word of 16 bits for the load and one for the share, each with up to four times the room
    pushed = np.arange(len(loads)) % 50 != 0
    np.testing.assert_allclose(
        given[pushed], wanted[pushed], atol=2.0**-11 * max(1.0, np.abs(wanted[pushed]).max())
    )


@pytest.mark.parametrize("bound", [0.0, -0.5, 2.0])
@pytest.mark.parametrize("kind", ["difference", "quotient"])
def test_both_sides_of_a_limit_are_told_apart(kind, bound):
    """Beyond it, the sign of a difference, and small dividends of a large quotient, still count."""

    @cnnum.program
    def limited(frame):
        load = frame.normal
        if kind == "difference":
            return {"share": minimum(load * load * load - load * load, bound)}
        return {"share": maximum(minimum(load / (load.max() - 1.0 + 1e-4), bound + 1.0), 0.0)}

    random = np.random.default_rng(1)
    if kind == "difference":
        swell = np.clip(np.sin(np.arange(60) * 2.0 * np.pi / 60), 0.0, None)
        peaks = np.exp(-random.uniform(0.0, 4.0, (60, 4, 4)))
        loads = 30.0 * swell[:, None, None] * peaks + 0.01 * random.normal(size=(60, 4, 4))
        wanted = np.minimum(loads**3 - loads**2, bound)
    else:
        loads = np.full((40, 2, 2), 0.001)
        loads[::2, 0, 0], loads[1::2, 0, 0] = 2.0, 1.0
        tops = loads.max(axis=(1, 2), keepdims=True) - 1.0 + 1e-4
        wanted = np.clip(loads / tops, 0.0, bound + 1.0)
    engine = cnnum.Engine("reference", precision="q15")
    plan = engine.compile(limited, loads.shape[1:], channels=("normal",), like=loads[..., None])
    stream = plan.stream()
    given = np.stack([stream.push(frame[..., None])["share"] for frame in loads])
    # a load of 16 bits, whose third power is taken: a hundredth of the smallest that is not limited
    assert np.abs(given - wanted).max() < 0.02 * np.abs(wanted).max()


@cnnum.program
def above_rest(frame, *, rate: float = 200.0):
    """Loads above the first half second, 0 within it."""
    rest = frame.memory("rest")
    resting = frame.age < 0.5 * rate
    rest.store(where(resting, frame.normal, rest.value))
    return {"load": where(resting, 0.0, frame.normal - rest.value)}


@pytest.mark.parametrize("rate", [50.0, 1000.0])
def test_the_vector_is_long_enough_for_the_rate(rate):
    count = round(1.5 * rate)
    loads = np.random.default_rng(3).uniform(0.0, 5.0, (count, 2, 2, 1))
    exported = cnnum.export(above_rest, like=loads, rate=rate)
    assert exported.vector.still == ()


def test_the_error_of_an_export_is_that_of_plain_arithmetic():
    @cnnum.program
    def coarse(frame):
        root = sqrt(frame.normal)
        return {"root": root, "sign": where(frame.normal > 3.0, 1.0, -1.0), "none": 0.0 * root}

    loads = np.random.default_rng(5).uniform(0.0, 9.0, (60, 2, 3, 1))
    exported = cnnum.export(coarse, precision="q7", like=loads)
    formats = {name: exported.program.arrays[name].format for name in ("in_normal", "out_root")}
    # the nearest number of the input, and of the root the nearest one below or above
    given = np.clip(np.floor(loads * 2.0 ** formats["in_normal"].fraction + 0.5), -128, 127)
    roots = np.sqrt(given * 2.0 ** -formats["in_normal"].fraction)
    rounded = np.round(roots * 2.0 ** formats["out_root"].fraction)
    rounded *= 2.0 ** -formats["out_root"].fraction
    size = np.sqrt(np.mean(loads))
    error = np.sqrt(np.mean((rounded - np.sqrt(loads)) ** 2)) / size
    assert exported.errors["root"] == pytest.approx(error, rel=0.2)
    assert 1e-4 < error < 0.05
    assert exported.errors["none"] == 0.0
    # of cells beside the threshold, whose inputs are rounded across it
    assert 0.0 <= exported.errors["sign"] < 0.3
    assert "at most ('" in " ".join(exported.about())
    assert cnnum.export(coarse, precision="float32", like=loads).errors == {}


def test_an_output_that_should_be_0_is_named():
    @cnnum.program
    def nothing(frame):
        return {"cut": maximum(frame.normal - 9.0, 0.0), "load": frame.normal}

    loads = np.random.default_rng(6).uniform(0.0, 8.0, (40, 2, 2, 1))
    exported = replace(cnnum.export(nothing, like=loads), errors={"cut": np.inf, "load": 0.7})
    text = " ".join(exported.about())
    assert "Not 0, as in floating point: 'cut'." in text
    assert "That of 'load' exceeds a half" in text
    assert "0.7 at most ('load')" in text
