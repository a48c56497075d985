"""Sweeps: judged as the template's check judges, in any chunks, on one machine or a cluster."""

import itertools
import json
import os
import re
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from scipy.special import erfc

from cnnum import Chip, Engine, get_template
from cnnum.design import sweep
from cnnum.design.experiment import Experiment, load_experiment
from cnnum.design.run_task import _case, biases_of, changed_weights, run_task
from cnnum.design.sweeping import ChunkStore, failures
from cnnum.errors import (
    DeviceError,
    SizeError,
    TemplateError,
    TemplateFileError,
    UnknownNameError,
)
from cnnum.report.sweep_page import page
from cnnum.templating.checks.registry import form_of
from cnnum.templating.checks.robustness import flips

pytest.importorskip("xarray", reason="the extra 'tables' is not installed")


def small(**changes):
    given = {
        "template": "HOLE",
        "axes": {"size": (6.0, 8.0), "A[1, 1]": (2.5, 3.0), "mismatch": (0.0, 0.1)},
        "draws": 6,
        "engine": "numba",
        "chunk": 7,
    }
    return Experiment(**(given | changes))


def test_a_sweep_has_every_axis_and_no_wrong_cell_without_mismatch():
    found = sweep(small()).results
    assert dict(found.sizes) == {"size": 2, "A[1, 1]": 2, "mismatch": 2, "draw": 6}
    assert float(found["flipped"].sel({"mismatch": 0.0}).max()) == 0.0
    assert float(found["flipped"].sel({"mismatch": 0.1}).mean()) > 0.0
    assert (found["settled"].values[found["flipped"].values == 0.0] == 1.0).all()


def test_chunks_change_nothing():
    whole, parts = (sweep(small(chunk=chunk)).results for chunk in (24, 5))
    assert whole.identical(parts)


def test_engines_judge_alike(fast):
    if fast.name != "opencl":
        pytest.skip("no OpenCL here")
    one, other = (sweep(small(engine=name)).results for name in ("numba", "opencl"))
    # a template on the fence may go either way in float32: few are
    assert float(np.abs(one["flipped"] - other["flipped"]).mean()) <= 1 / 48


def test_flip_rates_are_those_of_the_check():
    axes = {"mismatch": (0.1,)}
    found = sweep(small(axes=axes, draws=60, pictures=99, chunk=60)).results
    (known,) = flips(get_template("HOLE"), Engine("numba"), mismatches=(0.1,), bits=(), draws=60)
    rate = float(found["flipped"].mean())
    # two samples of 60: four standard deviations of their difference
    assert abs(rate - known.flipped) < 4 * np.sqrt(2 * 0.25 / 60)


def test_coarse_maps_cost_a_level_at_most():
    bits = (4.0, 8.0, 16.0)
    given = {"template": "DIFFUS", "engine": "reference", "draws": 1}
    found = sweep(small(axes={"state_bits": bits}, **given)).results["error"].values.ravel()
    plain = sweep(small(axes={}, **given)).results["error"].values.ravel()
    levels = 1.0 / (2.0 ** (np.array(bits) - 1.0) - 1.0)
    # diffusion enlarges no error: half a level of the input, and half of the output
    assert (found < levels + plain).all()
    assert (found[:2] > 0.25 * levels[:2]).all()


@pytest.mark.parametrize("name", ["EDGE", "HOLE"])
def test_chips_of_a_sweep_are_those_of_a_run(name, fast):
    chips = {"weight_bits": 6.0, "state_bits": 5.0, "chip_noise": 0.3, "chip_mismatch": 0.1}
    axes = {key: (value,) for key, value in chips.items()} | {"chip_seed": (3.0, 4.0)}
    experiment = small(template=name, axes=axes, draws=1, engine=fast.name, pictures=3)
    found = run_task(experiment, 0, 2)
    template = get_template(name)
    case = _case(experiment, template, {})
    for number, seed in enumerate((3, 4)):
        chip = Chip(weight_bits=6, state_bits=5, noise=0.3, mismatch=0.1, seed=seed)
        run = Engine("numba").run(
            template, input=case.input, state=case.state, duration=case.duration, chip=chip
        )
        apart = np.abs(run.output - form_of(template).expected(template, case))
        assert found["wrong"][number] == (apart > 0.5).mean()
        # a level of the output: it may be rounded up in one run and down in the other
        assert found["error"][number] == pytest.approx(apart.max(), abs=1.01 / 15)


def test_draws_are_chips_of_their_own():
    axes = {"chip_mismatch": (0.0, 0.2)}
    found = sweep(small(template="LAPLACE", axes=axes, engine="numba")).results["error"]
    assert len(np.unique(found.sel(chip_mismatch=0.2))) == 6
    assert len(np.unique(found.sel(chip_mismatch=0.0))) == 1


def test_chips_have_linear_couplings():
    with pytest.raises(TemplateError, match="'weight_bits' belongs to chips"):
        small(template="MEDIAN", axes={"weight_bits": (8.0,)})
    with pytest.raises(TemplateError, match="takes whole numbers"):
        small(axes={"chip_seed": (0.5,)})


@pytest.mark.parametrize(("axis", "value"), [("bits", 7.5), ("state_bits", 40.0)])
def test_bits_are_whole_numbers(axis, value):
    with pytest.raises(TemplateError, match=f"'{axis}' takes whole numbers from 2 to 32"):
        small(axes={axis: (value,)})


def test_runs_know_their_own_random_numbers():
    experiment = small(axes={"noise": (0.2,), "mismatch": (0.1,)}, draws=5)
    together = run_task(experiment, 0, 5)
    alone = run_task(experiment, 3, 4)
    for name, values in together.items():
        assert values[3] == alone[name][0]


def test_offsets_of_cells_flip_as_often_as_their_closed_form_says():
    """x' = w + offset within ±1, w = ±2: a cell is wrong after T where offset < 0.5/T − 2."""
    template = get_template("LOGNOT")
    axes = {"offset": (0.0, 1.0)}
    found = sweep(small(template="LOGNOT", axes=axes, draws=60, pictures=1, chunk=60)).results
    time = float(template.duration)
    expected = erfc((2.0 - 0.5 / time) / np.sqrt(2.0)) / 2.0
    wrong = found["wrong"].sel(offset=1.0)
    # four standard deviations of a share of 60 × 64 cells
    assert abs(float(wrong.mean()) - expected) < 4 * np.sqrt(expected / (60 * 64))
    assert float(found["wrong"].sel(offset=0.0).max()) == 0.0


def test_a_drift_is_one_slope_across_the_array():
    found = biases_of((8, 8), {"drift": 2.0}, np.random.default_rng(0))
    assert found + found[::-1, ::-1] == pytest.approx(np.zeros((8, 8)), abs=1e-12)
    assert np.diff(found, 2, axis=0) == pytest.approx(np.zeros((6, 8)), abs=1e-12)
    corners = [
        biases_of((5, 9), {"drift": 2.0}, np.random.default_rng(seed))[[0, 0], [0, -1]]
        for seed in range(2000)
    ]
    # of slope · half diagonal: two corners have that mean square; 2,000 draws, four deviations
    assert np.mean(np.square(corners)) == pytest.approx(4.0, rel=4 * np.sqrt(2 / 2000))


@pytest.mark.parametrize("name", ["HOLE", "MAXLOC"])
def test_a_bias_belongs_to_its_run(name):
    experiment = small(template=name, axes={"offset": (0.2,), "drift": (0.1,)}, draws=3, pictures=2)
    together = run_task(experiment, 0, 3)
    alone = run_task(experiment, 2, 3)
    for key, values in together.items():
        assert values[2] == alone[key][0], key


@pytest.mark.parametrize("suffix", ["nc", "zarr"])
def test_a_file_is_read_back_as_it_was(tmp_path, suffix):
    xarray = pytest.importorskip("xarray")
    if suffix == "zarr":
        pytest.importorskip("zarr", reason="the extra 'zarr' is not installed")
    path = tmp_path / f"out.{suffix}"
    made = sweep(small(axes={"mismatch": (0.0,)}, draws=2), path)
    opener = xarray.open_dataset(
        path,
        engine="scipy" if suffix == "nc" else "zarr",
        **({} if suffix == "nc" else {"consolidated": False}),
    )
    with opener as read:
        assert read.equals(made.results)
    assert not list(tmp_path.glob("*.parts"))


def test_results_of_another_experiment_are_refused(tmp_path):
    path = tmp_path / "out.nc"
    folder = tmp_path / "out.nc.parts"
    folder.mkdir()
    (folder / "manifest.json").write_text('{"key": "another", "chunk": 3}')
    with pytest.raises(TemplateFileError, match="another experiment"):
        sweep(small(), path)


BAD_AXES = {
    'method = ["auto", "exact", "rungekutta"]': "Unknown method 'exact'",
    'method = ["auto", 3]': "'method' takes names, got 3",
    'precision = ["float16"]': "Unknown precision 'float16' (did you mean 'float64'",
    'boundary = ["mirror"]': "Unknown boundary 'mirror'",
    "size = [8.5]": "'size' takes whole numbers, got 8.5",
    "tau = [inf]": "'tau' takes finite numbers",
    "noise = [nan]": "'noise' takes finite numbers",
    '"A[3, 1]" = [1.0]': "beyond the 3×3 cells of 'HOLE'",
    '"A[1, 1]" = [1.0]\n"A[1,1]" = [2.0]': "'A[1, 1]' is given twice",
}


@pytest.mark.parametrize("axis", BAD_AXES)
def test_axes_that_cannot_be_run_are_refused_at_the_start(tmp_path, axis):
    """Before, they were flips."""
    (tmp_path / "e.toml").write_text(f'template = "HOLE"\nengine = "numba"\n[axes]\n{axis}\n')
    with pytest.raises((TemplateError, UnknownNameError), match=re.escape(BAD_AXES[axis])):
        load_experiment(tmp_path / "e.toml")


def test_a_bad_axis_is_a_mistake_of_the_user(tmp_path):
    (tmp_path / "e.toml").write_text('template = "HOLE"\n[axes]\nmethod = ["auto", "exact"]\n')
    found = cnnum_command(tmp_path, "sweep", "e.toml")
    assert found.returncode == 2
    assert "Unknown method 'exact'" in found.stderr
    assert not list(tmp_path.glob("e.nc*"))


def cnnum_command(folder, *words):
    return subprocess.run(
        [sys.executable, "-m", "cnnum", *words], cwd=folder, capture_output=True, text=True
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"engine": "cuda"}, "Unknown engine 'cuda'"),
        ({"draws": 2.5}, "'draws' must be a whole number"),
        ({"axes": {"B": (1.0,)}, "template": "RECALL_WITHOUT_INPUT"}, "Unknown template"),
        ({"axes": {"z": (10**400,)}}, "'z' takes finite numbers"),
        ({"axes": {"z": (True,)}}, "'z' takes finite numbers"),
    ],
)
def test_parts_of_an_experiment_are_refused(changes, words):
    with pytest.raises((TemplateError, UnknownNameError), match=words):
        small(**changes)


def test_a_case_that_cannot_be_made_is_refused_before_any_run():
    with pytest.raises(SizeError, match="picture of the check of 10000000×10000000 cells"):
        sweep(small(axes={"size": (8.0, 1e7)}))


def test_runs_that_fail_are_counted_apart_with_their_reasons(tmp_path):
    """HOLE has no propagator: no flips, but failures; those of the other methods are judged."""
    axes = {"method": ("euler", "propagator"), "A[1, 1]": (3.0, 3.5)}
    found = sweep(small(axes=axes, draws=2)).results
    failed = found["failed"].sel({"method": "propagator"})
    assert (failed > 0).all()
    assert (found["failed"].sel({"method": "euler"}) == 0).all()
    assert np.isnan(found["flipped"].sel({"method": "propagator"})).all()
    assert (found["flipped"].sel({"method": "euler"}) == 0.0).all()
    ((sentence, count),) = failures(found).items()
    assert count == 4
    assert "has no propagator" in sentence
    text = page(found)
    assert "4 of 8 runs failed: " in unescape(text)
    assert "share of runs that failed" in text


@pytest.mark.one_in(2)
@pytest.mark.parametrize("methods", ['["propagator"]', '["propagator", "euler"]'])
def test_failures_are_printed_and_a_sweep_of_nothing_else_has_failed(tmp_path, methods):
    text = f'template = "HOLE"\nengine = "numba"\n[axes]\nmethod = {methods}\n'
    (tmp_path / "e.toml").write_text(text)
    found = cnnum_command(tmp_path, "sweep", "e.toml", "--json")
    record = json.loads(found.stdout)
    assert record["failed"] == 1
    assert list(record["reasons"].values()) == [1]
    assert record["judged"] == methods.count(",")
    assert found.returncode == 1 - record["judged"]


def test_an_answer_that_is_not_finite_is_a_failure_and_no_success():
    axes = {"A[1, 1]": (0.5, 1e3)}
    experiment = Experiment("tactile_diffusion", axes=axes, engine="numba", duration=5.0)
    with np.errstate(all="ignore"):
        found = sweep(experiment).results
    assert found["failed"].values.ravel().tolist() == [0, 1]
    assert np.isnan(found["flipped"].values.ravel()[1])


def test_what_fails_in_the_machine_stops_a_sweep(monkeypatch):
    def lost(*_, **__):
        raise DeviceError("The device is gone.")

    monkeypatch.setattr(Engine, "run", lost)
    with pytest.raises(DeviceError, match="is gone"):
        sweep(small())


def test_a_factor_scales_a_weight_that_is_set_in_any_order():
    one, other = {"A": (0.5,), "A[1, 1]": (2.0,)}, {"A[1, 1]": (2.0,), "A": (0.5,)}
    template, rng = get_template("HOLE"), np.random.default_rng(0)
    for axes in (one, other):
        parts = changed_weights(template, small(axes=axes).place(0), rng)
        assert parts["A"][0, 0, 1, 1] == 1.0


def test_equal_experiments_have_equal_keys():
    """Whatever types their numbers have, and however a weight's name is spaced."""
    plain = small(axes={"A[0, 1]": (0.5, 2.0), "size": (8.0,)}, duration=3.0)
    others = [
        small(axes={"A[0,1]": (0.5, 2), "size": (8,)}, duration=3),
        small(axes={"A[0, 1]": np.array([0.5, 2.0]), "size": np.arange(8, 9)}, duration=3.0),
        small(axes={"A[0, 1]": (np.float32(0.5), np.float64(2.0)), "size": (np.int64(8),)},
              duration=np.float64(3.0), draws=np.int64(6)),
    ]  # fmt: skip
    assert {one.key for one in others} == {plain.key}
    assert small(axes={"A[0, 1]": (0.5, 3.0), "size": (8.0,)}, duration=3.0).key != plain.key


@pytest.mark.parametrize(
    "content",
    [b"", b"\xff", b"[]", b"3", b'{"key": 1, "chunk": 5}', b'{"key": "k"}', b"[" * 100_000]
    + [
        b'{"key": "k", "chunk": %s}' % chunk
        for chunk in (b"0", b"-1", b"true", b"1e9", b"1" * 9999)
    ],
)
def test_a_damaged_manifest_is_a_sentence(tmp_path, content):
    folder = tmp_path / "out.nc.parts"
    folder.mkdir()
    (folder / "manifest.json").write_bytes(content)
    with pytest.raises(TemplateFileError, match=r"manifest.json' is damaged"):
        sweep(small(), tmp_path / "out.nc")
    assert (folder / "manifest.json").read_bytes() == content


@pytest.mark.parametrize("damage", ["cut", "text", "objects", "missing", "shape", "encrypted"])
def test_a_damaged_part_is_a_sentence(tmp_path, damage):
    store = ChunkStore(tmp_path / "parts", "key")
    store.begin(2)
    good = {"a": np.zeros(2), "why": np.array(["", "x"])}
    store.write((0, 2), good)
    (part,) = store.read([(0, 2)], ("a",), "why")
    assert part["why"].tolist() == ["", "x"]
    place = next((tmp_path / "parts").glob("*.npz"))
    whole = bytearray(place.read_bytes())
    others = {
        "objects": {**good, "a": np.array([1, None])},
        "missing": {"a": good["a"]},
        "shape": {**good, "a": np.zeros((2, 1))},
    }
    if damage in others:
        np.savez(place, **others[damage])
    else:
        whole[6] |= damage == "encrypted"
        whole[whole.index(b"PK\1\2") + 8] |= damage == "encrypted"
        place.write_bytes(
            b"hello" if damage == "text" else whole[: 300 if damage == "cut" else None]
        )
    with pytest.raises(TemplateFileError, match=r"npz' is damaged: remove it"):
        list(store.read([(0, 2)], ("a",), "why"))


def test_a_folder_of_others_and_a_file_that_is_there_are_kept(tmp_path):
    pytest.importorskip("xarray", reason="the extra 'tables' is not installed")
    path, folder = tmp_path / "out.nc", tmp_path / "out.nc.parts"
    folder.mkdir()
    (folder / "mine").write_text("precious")
    with pytest.raises(TemplateFileError, match="holds other files"):
        sweep(small(), path)
    assert (folder / "mine").read_text() == "precious"
    (folder / "mine").unlink()
    one = small(axes={"mismatch": (0.0,)}, draws=2)
    sweep(one, path)
    before = path.read_bytes()
    with pytest.raises(TemplateFileError, match="already exists"):
        sweep(one, path)
    assert path.read_bytes() == before
    sweep(one, path, force=True)
    assert [each.name for each in tmp_path.iterdir()] == ["out.nc"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('template = "HOLE"\n[axes]\nsizes = [8]\n', "Unknown axis 'sizes'"),
        ('template = "HOLE"\n[axes]\nnoise = []\n', "at least one value"),
        ('template = "HOLE"\n[axes]\nnoise = [-0.1]\n', "numbers from 0"),
        ('template = "HOLE"\ndraw = 3\n', "unknown key 'draw'"),
        ("draws = 3\n", "'template' is missing"),
        ('template = "HOLE"\nduration = "rest"\n', "above 0 or 'settle', got 'rest'"),
        ('template = "HOLE"\nduration = -1\n', "above 0 or 'settle', got -1"),
    ],
)
def test_what_is_no_experiment_is_said(tmp_path, text, words):
    path = tmp_path / "e.toml"
    path.write_text(text)
    with pytest.raises(TemplateError, match=words):
        load_experiment(path)


def test_a_check_judges_no_run_that_is_longer_than_its_closed_form_holds():
    """AVERAGE's is that of the linear course: e^(4 t) is beyond any output after some time."""
    axes = {"A[1, 1]": (1.0, 2.0)}
    long = sweep(Experiment("AVERAGE", axes=axes, duration=60.0, engine="numba")).results
    assert np.isnan(long["error"]).all()
    assert np.isnan(long["flipped"]).all()
    assert (long["settled"] >= 0.0).all()
    text = page(long)
    unknown = "share of wrong cells, largest error: not known, for the template's check ends before"
    assert unknown in unescape(text)
    assert "2 values of A[1, 1] × 1 draw." in text
    own = sweep(Experiment("AVERAGE", axes=axes, engine="numba")).results
    assert np.isfinite(own["error"]).all()


def test_runs_until_they_settle_give_the_settle_time():
    """Cells of EDGE are uncoupled: they saturate, and then decay as e^(−t) to a known end."""
    axes = {"size": (6.0, 8.0), "mismatch": (0.0, 0.05)}
    fixed = Experiment("EDGE", axes=axes, engine="numba")
    assert (sweep(fixed).results["time"] == get_template("EDGE").duration).all()
    rest = sweep(replace(fixed, duration="settle")).results
    assert (rest["settled"] == 1.0).all()
    assert (rest["flipped"] == 0.0).all()
    # rates of order 1 to 10 fall to the engine's tolerance of rest, 1e-3 to 1e-6 of them
    assert ((rest["time"] > 7.0) & (rest["time"] < 16.0)).all()
    grows = Experiment("AVERAGE", axes={"size": (6.0, 8.0)}, engine="numba", duration="settle")
    assert np.isnan(sweep(grows).results["flipped"]).all()


def test_the_page_has_a_section_an_axis_and_one_a_pair():
    text = page(sweep(small()).results)
    sections = text.split("<section")[1:]
    heads = [part.partition("</i>")[2].partition("<")[0] for part in sections]
    axes = ["size", "A[1, 1]", "mismatch"]
    assert heads == [*axes, *(f"{a} and {b}" for a, b in itertools.combinations(axes, 2))]
    # a figure that is the same everywhere is a sentence
    assert all("<svg" in part or "everywhere" in part for part in sections)
    assert [part.count("<svg") for part in sections[3:]] == [2, 2, 2]
    assert "Sweep of HOLE" in text
    assert "http" not in text


@pytest.mark.filterwarnings("ignore")  # of a library that loses a worker, as it should
def test_a_cluster_loses_a_worker_and_nothing_else(tmp_path):
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    experiment = small(draws=12, chunk=6)
    expected = sweep(experiment).results
    killed = threading.Event()
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0"}
    with distributed.LocalCluster(**options, silence_logs=50) as cluster:
        pids = [worker.pid for worker in cluster.workers.values()]

        def done(count, total):
            if count == 2 and not killed.is_set():
                os.kill(pids[0], signal.SIGKILL)
                killed.set()

        path = tmp_path / "out.nc"
        found = sweep(experiment, path, scheduler=cluster.scheduler_address, done=done)
    assert killed.is_set()
    assert found.run_now == found.tasks
    assert found.results.identical(expected)
