"""Each extra alone: with what it brings its feature works; without it one sentence names it."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]

HOOK = """
import importlib.machinery, sys

class Installed(importlib.machinery.PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        if name.partition(".")[0] in {others!r}:
            return None
        return super().find_spec(name, path, target)

place = sys.meta_path.index(importlib.machinery.PathFinder)
sys.meta_path[place] = Installed
import numpy as np
import cnnum
"""

SWEEP = """
from cnnum.design import sweep
from cnnum.design.experiment import Experiment
experiment = Experiment("AVERAGE", axes={"mismatch": (0.0,)}, draws=2, engine="numba", pictures=2)
"""

# what a user does who has installed the extra, and nothing else
FEATURES = {
    "pictures": """
picture = 1.0 - 2.0 * np.eye(4)
cnnum.save_picture(picture, "a.png")
assert (cnnum.load_picture("a.png") == picture).all()
""",
    "film": """
cnnum.save_film(np.zeros((3, 16, 16)), "a.webm")
import av
with av.open("a.webm") as film:
    assert len(list(film.decode(video=0))) == 3
""",
    "hdf5": """
taxels = np.arange(60.0).reshape(5, 2, 2, 3)
cnnum.Recording(taxels, rate=9.0).save("a.h5")
import h5py
with h5py.File("a.h5") as file:
    assert (file["values"][...] == taxels).all()
""",
    "tables": """
result = cnnum.Engine("numba").run("EDGE", input=np.eye(4))
assert len(result.to_dataframe()) == 16
assert result.to_xarray()["output"].shape == (4, 4)
""",
    "search": """
from cnnum.design.search import Search, search
wanted = Search(cnnum.get_template("CCD_HOR"), generations=1, restarts=1, population=4, draws=2)
assert search(wanted, cnnum.Engine("numba")).template.name
""",
    "zarr": SWEEP
    + """
sweep(experiment, "a.zarr")
import xarray
assert xarray.open_zarr("a.zarr")["error"].shape[-1] == 2
""",
    "cluster": SWEEP
    + """
if __name__ == "__main__":
    from cnnum.errors import missing_extra
    try:
        from dask.distributed import LocalCluster
    except ModuleNotFoundError:
        sweep(experiment, "a.zarr", scheduler="tcp://127.0.0.1:9")
    with LocalCluster(n_workers=1, processes=False, dashboard_address=":0") as cluster:
        found = sweep(experiment, "a.zarr", scheduler=cluster.scheduler_address)
    assert found.results["error"].size == 2
""",
    "view": """
import asyncio, urllib.request
from cnnum.drivers import open_driver
from cnnum.live.feeds import ArrayFeed
from cnnum.live.server import Place, serving

async def served():
    async with serving(ArrayFeed("a", open_driver("simulated")), Place(port=0)) as (_, _, port):
        page = await asyncio.to_thread(urllib.request.urlopen, f"http://127.0.0.1:{port}/")
        return page.read()

assert b"<html" in asyncio.run(served())
""",
    "embedded": """
from cnnum.embedded.making import make
from cnnum.embedded.formats import precision_named
from cnnum.graph.schedule import schedule
from cnnum.lab.embedded.cortex_m import Board

@cnnum.program
def doubled(frame):
    return {"twice": 2.0 * frame.normal}

names = ("shear_x", "shear_y", "normal")
planned = schedule(doubled.trace((2, 2), names), names, None)
frames = np.random.default_rng(0).uniform(-1, 1, (4, 2, 2, 2, 3))
made = make("doubled", planned, precision_named("q15"), frames)
counted = Board.built(made, frames[:, 0], "m4").run(frames[:, 0])
assert counted.wrong == 0
assert all(counted.instructions)
""",
    "lerobot": """
import pathlib
from cnnum.recordings.lerobot import Episode, write_lerobot
taxels = np.random.default_rng(0).normal(size=(30, 2, 2, 3))
recording = cnnum.Recording(taxels, rate=30.0)
rows = write_lerobot([Episode(recording, "a")], pathlib.Path("set"), 30.0, robot="b")
assert rows == 30
""",
    "bags": """
import pathlib
try:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore
except ModuleNotFoundError:
    pathlib.Path("bag").mkdir()
    pathlib.Path("bag/metadata.yaml").touch()
else:
    store, kind = get_typestore(Stores.ROS2_HUMBLE), "geometry_msgs/msg/Vector3"
    with Writer(pathlib.Path("bag"), version=9) as writer:
        connection = writer.add_connection("/force", kind, typestore=store)
        for n in range(5):
            data = store.serialize_cdr(store.types[kind](1.0, 2.0, float(n)), kind)
            writer.write(connection, n * 10_000_000, data)
pathlib.Path("bag.toml").write_text('shape = [1, 1]\\ntopic = "/force"\\n')
recording = cnnum.load_recording("bag")
assert recording.values[:, 0, 0].tolist() == [[1.0, 2.0, float(n)] for n in range(5)]
assert round(recording.rate) == 100
""",
    "fem": """
from cnnum.tactile.cover.fem.geometry import Shape
from cnnum.tactile.cover.fem.plate import make_bodies
bodies = make_bodies(Shape(20.0, 20.0, growth=1.5), 4, poisson=0.4, patch=0.4)
assert np.isfinite(bodies.profiles(1.0, np.array([0.0, 1.0]))).all()
""",
    "texture": """
from cnnum.tactile.texture_materials import classify
rng = np.random.default_rng(0)
truth = np.repeat([0, 1], 30)
logs = rng.normal(size=(60, 2)) + 9.0 * truth[:, None]
assert classify(np.exp(logs), truth, np.arange(60), names=("a", "b")).accuracy == 1.0
""",
    "peers": """
from cnnum.lab.bench.peers import PEERS
for peer in PEERS:
    if peer.extra == "peers":
        peer.load()
""",
}
# not here: Rerun and the engines to race, which bring hundreds of megabytes and are in no locked
# set; and "autodiff" and "oracles", which tests alone import


def brought(names):
    """The distributions that come with some requirements, as pip would bring them."""
    found, left = set(), list(names)
    while left:
        name = re.split(r"[\[<>=!~;( ]", left.pop())[0].lower().replace("_", "-")
        if name in found:
            continue
        found.add(name)
        try:
            needed = requires(name) or []
        except PackageNotFoundError:
            continue
        left += [one for one in needed if "extra ==" not in one]
    return found


def others(extra):
    """The importable names of what is installed here and neither the extra nor cnnum needs."""
    wanted = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"].get(extra, ())]
    kept = brought(wanted)
    return {
        module
        for module, owners in packages_distributions().items()
        if not any(owner.lower().replace("_", "-") in kept for owner in owners)
        and module not in {"cnnum", "_distutils_hack", "pkg_resources", "setuptools"}
    }


def ran(extra, feature, folder):
    code = HOOK.format(others=others(extra)) + FEATURES[feature]
    return subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False
    )


@pytest.mark.one_in(3)
@pytest.mark.parametrize("extra", FEATURES)
def test_an_extra_alone_brings_what_its_feature_needs(extra, tmp_path):
    for requirement in PROJECT["optional-dependencies"][extra]:
        name = re.split(r"[\[<>=!~;( ]", requirement)[0]
        try:
            requires(name)
        except PackageNotFoundError:
            pytest.skip(f"{name} is not installed")
    done = ran(extra, extra, tmp_path)
    assert done.returncode == 0, done.stderr


# Pillow comes with Matplotlib, too
@pytest.mark.one_in(3)
@pytest.mark.parametrize("extra", sorted(FEATURES.keys() - {"pictures"}))
def test_without_it_a_sentence_names_the_extra(extra, tmp_path):
    done = ran("", extra, tmp_path)
    assert done.returncode == 1
    last = done.stderr.strip().splitlines()[-1]
    assert "MissingExtraError" in last, done.stderr
    # what needs xarray alone says so by the smallest extra that brings it
    named = {"zarr": "(zarr|tables)", "cluster": "(cluster|zarr|tables)"}.get(extra, extra)
    assert re.search(rf"pip install '\.\[{named}\]'", last), last


def test_a_recording_that_cannot_be_written_is_refused_before_it_begins(tmp_path):
    """HDF5 without h5py: one sentence at once, and nothing on the disk."""
    code = HOOK.format(others=others("")) + (
        "from cnnum.cli import main\n"
        "sys.argv = ['cnnum', 'record', 'contact', 'a.h5']\n"
        "import cnnum.drivers.registry as registry\n"
        "def opened(*_, **__): raise AssertionError('the array was opened')\n"
        "registry.open_driver = opened\n"
        "main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2, done.stderr
    assert "pip install '.[hdf5]'" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
