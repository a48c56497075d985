"""A scene over many recordings: its tables hold what each recording alone gives."""

import csv
import dataclasses
import os
import sys
import time
import zipfile
from collections import defaultdict
from urllib.parse import urlsplit

import numpy as np
import pytest

import cnnum
from cnnum.design.tasks import Parts, run_tasks
from cnnum.errors import MissingExtraError, RecordingError, SceneError, UnknownNameError
from cnnum.scenes import processing
from cnnum.scenes.processing import process, sources_of
from cnnum.scenes.scene_file import read_scene

SCENE = """
needs = ["contact"]
[engine]
name = "numba"
[array]
driver = "file"
path = "none.npz"
[program]
name = "contact"
[program.parameters]
push = 1.0
"""


def drawn(seed: int, frames: int = 90, rate: float = 100.0) -> cnnum.Recording:
    """Return a press on 3×3 taxels that begins, and may end, at a random frame."""
    rng = np.random.default_rng(seed)
    begin, end = rng.integers(35, 50), rng.integers(60, 120)
    bump = np.exp(-((np.indices((3, 3)) - rng.uniform(0.5, 1.5)) ** 2).sum(axis=0) / 3.0)
    force = np.zeros(frames)
    force[begin:end] = rng.uniform(300.0, 900.0)
    values = force[:, None, None, None] * bump[..., None] * np.array([0.1, 0.0, 1.0])
    if seed % 3 == 0:
        values[20] = np.nan  # a bad frame
    return cnnum.Recording(values + rng.normal(0.0, 2.0, values.shape), rate=rate)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder of recordings of several kinds, among them files that are none."""
    place = tmp_path_factory.mktemp("set")
    (place / "scene.toml").write_text(SCENE)
    for seed in range(9):
        inner = place / f"day{seed % 2}"
        inner.mkdir(exist_ok=True)
        drawn(seed, rate=100.0 if seed < 7 else 50.0).save(
            inner / f"r{seed}.{('npz', 'mcap', 'csv')[seed % 3]}"
        )
    (place / "day0" / "r4_cut.mcap").write_bytes((place / "day0" / "r4.mcap").read_bytes()[:80])
    (place / "day1" / "junk.npz").write_bytes(b"PK nothing")
    (place / "day1" / "notes.txt").write_text("no recording, and no layout next to it")
    return place


@pytest.fixture(scope="module")
def whole(folder, tmp_path_factory):
    """Return the tables of a run that nothing disturbs."""
    out = tmp_path_factory.mktemp("whole") / "events.csv"
    made = process(folder, folder / "scene.toml", out)
    return made, out.read_bytes(), made.recordings.read_bytes()


def test_the_tables_hold_what_each_recording_alone_gives(folder, whole):
    made, events, recordings = whole
    rows = list(csv.DictReader(recordings.decode().splitlines()))
    names = [row["recording"] for row in rows]
    assert names == sorted(names)
    assert (made.count, made.failed, len(rows)) == (11, 2, 11)
    assert {row["recording"].rpartition("/")[2] for row in rows if row["error"]} == {
        "r4_cut.mcap", "junk.npz",
    }  # fmt: skip
    listed = list(csv.DictReader(events.decode().splitlines()))
    assert len(listed) == made.events_count > 9
    for row in rows:
        own = [event for event in listed if event["recording"] == row["recording"]]
        if row["error"]:
            assert not own
            assert row["recording"] in row["error"]
            continue
        # every recording by itself, with nothing kept from the one before
        seed = int(row["recording"].rpartition("/")[2][1])
        with cnnum.load_scene(folder / "scene.toml", recording=drawn(seed)) as scene:
            expected = scene.collect().events if seed < 7 else None
        assert (int(row["frames"]), int(row["bad"])) == (90, seed % 3 == 0)
        assert float(row["seconds"]) == pytest.approx(89 / (100.0 if seed < 7 else 50.0))
        if expected is not None:
            assert [(float(e["time"]), e["kind"]) for e in own] == [
                (event.time, event.kind) for event in expected
            ]
            assert [float(e["strength"]) for e in own if e["strength"]] == [
                event.strength for event in expected if event.strength is not None
            ]


def test_a_job_that_was_cut_off_goes_on_to_the_same_bytes(folder, whole, tmp_path, monkeypatch):
    monkeypatch.setattr(processing, "CHUNK", 3)
    out = tmp_path / "events.csv"

    def killed(count: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        process(folder, folder / "scene.toml", out, done=killed)
    assert not out.exists()
    with pytest.raises(RecordingError, match="results of another job"):
        process(folder / "day0", folder / "scene.toml", out)
    monkeypatch.setattr(processing, "CHUNK", 5)  # the parts say how they were cut
    made = process(folder, folder / "scene.toml", out)
    assert made.run_now == 11 - 3
    assert (out.read_bytes(), made.recordings.read_bytes()) == whole[1:]
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "events.csv", "events.recordings.csv",
    ]  # fmt: skip
    with pytest.raises(RecordingError, match="already exists"):
        process(folder, folder / "scene.toml", out)


def test_sentences_that_do_not_name_a_recording_are_left_to_replay(folder, tmp_path, caplog):
    moving = np.random.default_rng(3).normal(0.0, 2.0, (90, 3, 3, 3))
    moving[:, 1, 1, 2] += np.minimum(20.0 * np.arange(90), 900.0)  # from the first frame on
    file = cnnum.Recording(moving, rate=100.0).save(tmp_path / "moving.npz")
    made = process([file], folder / "scene.toml", tmp_path / "e.csv")
    assert (made.failed, caplog.messages) == (0, [])
    with cnnum.load_scene(folder / "scene.toml", recording=cnnum.load_recording(file)) as scene:
        scene.collect()
    assert "define the rest" in caplog.text


def test_an_address_gives_what_the_files_give(folder, whole, tmp_path):
    """Files in memory, in an archive and by an address of this machine, with junk among them."""
    names = [path.removeprefix(str(folder)) for path in processing._named([folder])]
    fsspec = pytest.importorskip("fsspec")
    system = fsspec.filesystem("memory")
    archive = tmp_path / "set.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                name = path.relative_to(folder).as_posix()
                system.pipe_file(f"/set/{name}", path.read_bytes())
                packed.writestr(name, path.read_bytes())
    try:
        for word, begin, end in (
            ("memory://set/", "memory://set", ""),
            (f"file://{folder}", f"file://{folder}", ""),
            (f"zip://day*/*::file://{archive}", "zip:/", f"::file://{archive}"),
            (f"zip://::{archive}", "zip:/", f"::{archive}"),
        ):
            assert [*processing._named([word])] == [f"{begin}{name}{end}" for name in names]
        made = process(word, folder / "scene.toml", tmp_path / "e.csv")
        assert (made.count, made.failed) == (11, 2)
        for table, expected in zip((made.events, made.recordings), whole[1:], strict=True):
            rows = list(csv.DictReader(expected.decode().splitlines()))
            for row in rows:
                name = row["recording"]
                row["recording"] = f"{begin}{name.removeprefix(str(folder))}{end}"
                if row.get("error"):
                    row["error"] = row["error"].replace(name, row["recording"])
            assert list(csv.DictReader(table.read_text().splitlines())) == rows
        # a file that is replaced is another job
        spec = read_scene(folder / "scene.toml")
        name = "memory:///set/day0/r0.npz"
        before = processing._key("", "", spec, [name])
        assert processing._key("", "", spec, [name]) == before
        system.pipe_file("/set/day0/r0.npz", b"other")
        assert processing._key("", "", spec, [name]) != before
        system.pipe_file("/set/meta/info.json", b"{}")
        with pytest.raises(RecordingError, match="copy it to this machine first"):
            process("memory://set", folder / "scene.toml", tmp_path / "x.csv")
        for word in ("memory://none/*", "nothing://a/b", "memory://set/scene.toml/*"):
            with pytest.raises(RecordingError, match=r"no recording in|cannot be read"):
                process(word, folder / "scene.toml", tmp_path / "x.csv")
    finally:
        system.rm("/set", recursive=True)
    made = process("memory://set/r.npz", folder / "scene.toml", tmp_path / "none.csv")
    assert "There is no file 'memory://set/r.npz'" in made.recordings.read_text()


def test_files_of_a_host_are_read_from_it_and_passwords_stay_out_of_tables(folder, tmp_path):
    """As of ftp, whose paths name no host: the files of another one have the same paths."""
    fsspec = pytest.importorskip("fsspec")
    stores = defaultdict[str | None, dict[str, object]](dict)

    class Hosted(fsspec.get_filesystem_class("memory")):
        protocol = "hosted"

        def __init__(self, host="", **options):
            super().__init__(**options)
            self.store, self.pseudo_dirs = stores[host], [""]

        @classmethod
        def _strip_protocol(cls, path):
            return f"/{urlsplit(path).path.strip('/')}".rstrip("/")

        @staticmethod
        def _get_kwargs_from_urls(path):
            return {"host": urlsplit(path).hostname}

    class Lost(Hosted):
        """One whose addresses cannot be made of its paths."""

        protocol = "lost"

        @classmethod
        def _strip_protocol(cls, path):
            host = urlsplit(path).hostname
            return f"/{host}{super()._strip_protocol(path)}" if host else path.rstrip("/")

    for kind in (Hosted, Lost):
        fsspec.register_implementation(kind.protocol, kind, clobber=True)
    data = (folder / "day0" / "r0.npz").read_bytes()
    address = "hosted://user:se:cr@et@two/day"
    fsspec.core.url_to_fs(address)[0].pipe_file("/day/r1.npz", data)
    for word in (address, f"{address}/", f"{address}/*", f"{address}/r1.npz"):
        named = processing._named([word])
        assert named == {f"{address}/r1.npz": "hosted://user:***@two/day/r1.npz"}
    fsspec.core.url_to_fs("hosted://one/day")[0].pipe_file("/day/bad.npz", b"none")
    sources = [address, "hosted://x:secret@one/"]
    made = process(sources, folder / "scene.toml", tmp_path / "e.csv")
    assert (made.count, made.failed) == (2, 1)
    written = made.events.read_text() + made.recordings.read_text()
    assert "cr@et" not in written
    assert "secret" not in written
    assert "hosted://user:***@two/day/r1.npz" in written
    fsspec.core.url_to_fs("lost://one/day")[0].pipe_file("/one/day/r1.npz", data)
    for word in ("lost://a:secret@one/day", "hosted://a:secret@two/none/*"):
        with pytest.raises(RecordingError, match=r"name each|no recording in") as said:
            process(word, folder / "scene.toml", tmp_path / "x.csv")
        assert "secret" not in str(said.value)


def test_a_layout_comes_with_its_file(folder, tmp_path):
    """A table in text that is elsewhere is read by the layout that lies next to it there."""
    pytest.importorskip("fsspec")
    place = tmp_path / "texts"
    place.mkdir()
    rows = drawn(1).values.reshape(90, -1)
    np.savetxt(place / "r.txt", rows, delimiter=",", header=",".join("abcdefghijklmnopqrstuvwxyzA"))
    names = ", ".join(f"'{letter}'" for letter in "abcdefghijklmnopqrstuvwxyzA")
    (place / "r.toml").write_text(
        f"shape = [3, 3]\nrate = 100.0\nvalues = [{names}]\norder = 'frames rows cols channels'\n"
    )
    (place / "notes.txt").write_text("no recording")
    tables = [
        process(word, folder / "scene.toml", tmp_path / f"{n}.csv")
        for n, word in enumerate((str(place), f"file://{place}"))
    ]
    assert [made.count for made in tables] == [1, 1]
    events = [made.events.read_text().replace("file://", "") for made in tables]
    assert events[0] == events[1]
    assert tables[0].events_count > 0


def tree(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_fields_are_those_of_each_recording_alone(folder, tmp_path, monkeypatch):
    """Also after an end on the way, and after one while the results are put in their places."""
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.replace('["contact"]', '["contact", "load_normal", "contact_map"]'))
    given = [folder / "day0" / "r[04]*", scene]
    made = process(*given, tmp_path / "a.csv", fields=tmp_path / "a.zarr")
    assert (made.count, made.failed) == (3, 1)
    rows = list(csv.DictReader(made.recordings.read_text().splitlines()))
    for number, row in enumerate(rows):
        if row["error"]:
            assert not (tmp_path / "a.zarr" / str(number)).exists()
            continue
        options = {"group": str(number), "consolidated": False}
        own = xarray.open_zarr(tmp_path / "a.zarr", **options)
        seed = int(row["recording"].rpartition("/")[2][1])
        with cnnum.load_scene(scene, recording=cnnum.load_recording(row["recording"])) as alone:
            expected = alone.collect().to_xarray()
        assert own.attrs["recording"] == row["recording"]
        assert len(own["time"]) == 90 - (seed % 3 == 0)
        assert set(own.data_vars) == {"load_normal", "contact_map"}
        for name in (*own.data_vars, "time", "frame", "load_is_bound"):
            np.testing.assert_array_equal(own[name], expected[name])

    monkeypatch.setattr(processing, "CHUNK", 1)

    def killed(count: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        process(*given, tmp_path / "b.csv", fields=tmp_path / "b.zarr", done=killed)
    assert not (tmp_path / "b.zarr").exists()
    with pytest.raises(RecordingError, match="another job"):
        process(*given, tmp_path / "b.csv")
    for step in ("written", "put_folder", "remove"):
        with monkeypatch.context() as patch:
            place = Parts if step == "remove" else processing
            patch.setattr(place, step, lambda *_, **__: killed(0, 0))
            with pytest.raises(KeyboardInterrupt):
                process(*given, tmp_path / "b.csv", fields=tmp_path / "b.zarr")
    made = process(*given, tmp_path / "b.csv", fields=tmp_path / "b.zarr")
    assert made.run_now == 0
    assert tree(tmp_path / "a.zarr") == tree(tmp_path / "b.zarr")
    for name in ("csv", "recordings.csv"):
        assert (tmp_path / f"a.{name}").read_bytes() == (tmp_path / f"b.{name}").read_bytes()
    assert {path.name for path in tmp_path.iterdir()} == {
        f"{name}.{kind}" for name in "ab" for kind in ("csv", "recordings.csv", "zarr")
    } | {"scene.toml"}
    with pytest.raises(RecordingError, match=r"b\.zarr' already exists"):
        process(*given, tmp_path / "c.csv", fields=tmp_path / "b.zarr")
    with pytest.raises(SceneError, match="requests only events and no field"):
        process(folder, folder / "scene.toml", tmp_path / "c.csv", fields=tmp_path / "c.zarr")


def test_parquet_holds_the_same_numbers(folder, whole, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    made = process([folder / "day0" / "r0.npz"], folder / "scene.toml", tmp_path / "e.parquet")
    table = parquet.read_table(made.events).to_pylist()
    lines = csv.DictReader(whole[1].decode().splitlines())
    expected = [line for line in lines if line["recording"].endswith("r0.npz")]
    assert [row["time"] for row in table] == [float(line["time"]) for line in expected]
    assert table[0]["load_is_bound"] is False
    assert parquet.read_table(made.recordings).to_pylist()[0]["bad"] == 1


def test_sources_are_files_folders_and_patterns(folder):
    files = sources_of([folder])
    assert [file.name for file in files] == [
        "r0.npz", "r2.csv", "r4.mcap", "r4_cut.mcap", "r6.npz", "r8.csv", "junk.npz", "r1.mcap",
        "r3.npz", "r5.csv", "r7.mcap",
    ]  # fmt: skip
    assert sources_of([str(folder / "*" / "r*.npz"), files[0]]) == [files[0], files[4], files[8]]
    assert sources_of(["nowhere.mcap"])[0].name == "nowhere.mcap"  # a row says that it is missing
    with pytest.raises(RecordingError, match="no recording in"):
        sources_of([str(folder / "*.bag")])


def test_a_damaged_data_set_is_one_row(tmp_path):
    info = tmp_path / "b" / "meta" / "info.json"
    info.parent.mkdir(parents=True)
    info.write_text("{")
    for name in ("a.npz", "c.npz"):
        cnnum.Recording(np.zeros((3, 2, 2)), rate=50.0).save(tmp_path / name)
    assert [file.name for file in sources_of([tmp_path])] == ["a.npz", "b", "c.npz"]
    with pytest.raises(RecordingError, match="is not JSON"):  # the words of its row
        cnnum.load_recording(tmp_path / "b")


def test_what_cannot_be_done_is_refused_before_the_work(folder, tmp_path, monkeypatch):
    with pytest.raises(UnknownNameError, match=r"kind of table '\.xls'"):
        process(folder, folder / "scene.toml", tmp_path / "e.xls")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match=r"ends in \.csv needs nothing"):
        process(folder, folder / "scene.toml", tmp_path / "e.parquet")
    assert not list(tmp_path.iterdir())


def test_names_of_any_bytes_are_rows(folder, tmp_path):
    """Such a name was no text, and ended the command after all recordings had run."""
    names = [b"=cmd,\n.npz", b"\xff.npz"]
    for name in names:
        (tmp_path / os.fsdecode(name)).write_bytes(b"none")
    made = process(tmp_path, folder / "scene.toml", tmp_path / "e.csv")
    with made.recordings.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["recording"] for row in rows] == [
        f"{tmp_path}/=cmd,\n.npz",
        f"{tmp_path}/\\udcff.npz",
    ]
    assert made.failed == 2
    assert all(row["error"] for row in rows)


def test_a_recording_counts_once(tmp_path, monkeypatch):
    (tmp_path / "r.npz").touch()
    for name in "abc":  # each would lead to three more, without end
        (tmp_path / name).symlink_to(tmp_path, target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    assert sources_of([tmp_path]) == [tmp_path / "r.npz"]
    assert [str(path) for path in sources_of(["r.npz", tmp_path, "./r.npz"])] == ["r.npz"]


def test_a_second_run_into_the_same_tables_is_refused(folder, tmp_path):
    """Both did all the work, and the first to end removed the results of the other."""
    out = tmp_path / "e.csv"
    parts = Parts(tmp_path / "e.csv.parts", "key", ".jsonl", RecordingError, "job")
    with parts.held(), pytest.raises(RecordingError, match="Another process works on the results"):
        process(folder, folder / "scene.toml", out)
    made = process(folder / "day1" / "junk.npz", folder / "scene.toml", out)
    assert made.failed == 1


@pytest.mark.parametrize("name", ["own.py", "scene.toml", "forces.toml", "r.txt", "r.toml"])
def test_whatever_decides_the_events_tells_jobs_apart(name, tmp_path):
    contents = {
        "own.py": "import cnnum\n@cnnum.program\ndef own(frame): return {'a': frame.z.max()}\n",
        "scene.toml": "needs = ['a']\n[array]\ndriver = 'simulated'\n"
        "[program]\nname = 'own.py:own'\n[calibration]\nfile = 'forces.toml'\n",
        "forces.toml": "", "r.txt": "1", "r.toml": "shape = [1, 1]\n",
    }  # fmt: skip
    for file, text in contents.items():
        (tmp_path / file).write_text(text)

    def key():
        spec = read_scene(tmp_path / "scene.toml", trust=True)
        return processing._key("", str(tmp_path / "scene.toml"), spec, [str(tmp_path / "r.txt")])

    before = key()
    assert key() == before
    (tmp_path / name).write_text(contents[name] + "\n")
    assert key() != before


DYING = """
import os, signal
from pathlib import Path

def square(number):
    mark = Path(__file__).with_name(f"died{number}")
    if number in (3, 7) and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if number < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number
"""


def test_a_task_whose_process_is_killed_runs_again(tmp_path, monkeypatch):
    (tmp_path / "dying_tasks.py").write_text(DYING)
    monkeypatch.syspath_prepend(tmp_path)
    from dying_tasks import square

    found = sorted(run_tasks(square, range(10), workers=2, name="squares"))
    assert found == [n * n for n in range(10)]
    assert len(list(tmp_path.glob("died*"))) == 2
    with pytest.raises(RecordingError, match="died 3 times in a row"):
        list(run_tasks(square, [-1, -2], workers=2, name="squares"))


def test_a_scheduler_that_is_lost_is_said_so():
    """Dask then gives the reason as if it were the result."""
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": ":0"}
    with distributed.LocalCluster(**options, processes=False, silence_logs=50) as cluster:
        naps, address = [0.0, *[0.2] * 5], cluster.scheduler_address
        results = run_tasks(time.sleep, naps, scheduler=address, name="naps")
        assert next(results) is None
        cluster.close()
        with pytest.raises(RecordingError, match="was lost, or has dropped the tasks"):
            list(results)


@pytest.mark.in_full("test_a_scheduler_that_is_lost_is_said_so")
def test_workers_that_die_at_each_task_are_said_so(tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    dask = pytest.importorskip("dask")
    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": ":0"}
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(**options, silence_logs=50) as cluster,
        pytest.raises(RecordingError, match="Worker after worker died"),
    ):
        list(run_tasks(os._exit, [1], scheduler=cluster.scheduler_address, name="ends"))


def test_no_task_is_lost_where_a_process_dies_between_two_results(tmp_path, monkeypatch):
    """The dead pool is then met as the next task is given, not as a result is waited for."""
    (tmp_path / "dying_tasks.py").write_text(DYING)
    monkeypatch.syspath_prepend(tmp_path)
    from dying_tasks import square

    found = []
    for result in run_tasks(square, range(10), workers=2, name="squares"):
        found.append(result)
        time.sleep(1.0 if len(found) == 1 else 0.0)  # the third task dies meanwhile
    assert sorted(found) == [n * n for n in range(10)]


def test_every_field_of_an_event_is_a_column():
    """A place is two columns, in cells and in mm."""
    places = {"where": {"row", "column"}, "place": {"x_mm", "y_mm"}}
    fields = {field.name for field in dataclasses.fields(cnnum.Event)}
    columns = set().union(*(places.get(name, {name}) for name in fields))
    assert columns | {"recording"} == set(processing.EVENTS)
    event = cnnum.Event(1.0, "slip", 3, sense=-1, motion="pivot")
    row = dict(zip(processing.EVENTS, processing.columns("a", event), strict=True))
    assert (row["motion"], row["sense"], row["kind"], row["frame"]) == ("pivot", -1, "slip", 3)
