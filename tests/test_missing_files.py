"""A file that is missing is a FileNotFoundError with its number, and an error of cnnum."""

import copy
import errno
import pickle
from pathlib import Path

import numpy as np
import pytest

import cnnum
from cnnum.drivers import open_driver
from cnnum.errors import PictureError, RecordingError, SceneError, TemplateFileError
from cnnum.tactile import taxel

CALLS = {
    "template": (lambda path: cnnum.load_template(path), "no.toml", TemplateFileError),
    "old template": (lambda path: cnnum.load_template(path), "no.tem", TemplateFileError),
    "scene": (lambda path: cnnum.load_scene(path), "no.toml", SceneError),
    "picture": (lambda path: cnnum.load_picture(path), "no.png", PictureError),
    "calibration": (lambda path: taxel.Calibration.load(path), "no.toml", cnnum.CnnumError),
    **{
        f"recording{suffix}": (lambda path: cnnum.load_recording(path), f"no{suffix}", kind)
        for suffix, kind in (
            (".mcap", RecordingError),
            (".npz", RecordingError),
            (".csv", cnnum.CnnumError),
            (".h5", cnnum.CnnumError),
            (".npy", cnnum.CnnumError),
        )
    },
    "driver": (
        lambda path: open_driver("file", {"path": str(path)}),
        "no.csv",
        cnnum.CnnumError,
    ),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_missing_file(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)  # sentences show the beginnings of long names
    call, file, kind = CALLS[name]
    with pytest.raises(FileNotFoundError) as caught:
        call(Path(file))
    assert isinstance(caught.value, kind)
    assert caught.value.errno == errno.ENOENT
    assert file in str(caught.value)
    for again in (pickle.loads(pickle.dumps(caught.value)), copy.copy(caught.value)):
        assert isinstance(again, FileNotFoundError)
        assert (type(again), str(again), again.errno) == (
            type(caught.value), str(caught.value), errno.ENOENT,
        )  # fmt: skip


def test_a_folder_and_a_damaged_file_are_none(tmp_path):
    with pytest.raises(TemplateFileError) as caught:
        cnnum.load_template(tmp_path)
    assert not isinstance(caught.value, FileNotFoundError)
    np.save(tmp_path / "half.npy", np.zeros(9))
    (tmp_path / "half.npz").write_bytes((tmp_path / "half.npy").read_bytes()[:99])
    with pytest.raises(cnnum.CnnumError) as damaged:
        cnnum.load_recording(tmp_path / "half.npz")
    assert not isinstance(damaged.value, FileNotFoundError)
