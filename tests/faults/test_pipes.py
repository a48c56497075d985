"""Pipes, devices and folders in the place of files that are read: one sentence at once, no wait."""

import os
import signal

import pytest
from click.testing import CliRunner

import cnnum
from cnnum.cli import main
from cnnum.errors import CnnumError
from cnnum.tactile.taxel import Calibration

SECONDS = 20
"""After which a read counts as one that waits: none takes a tenth."""

RECORDINGS = (".mcap", ".npz", ".npy", ".csv")
PICTURE = ("templates", "show", "EDGE", "--transient", "{0}/t.html", "--input", "{1}")
START = 'needs = ["contact"]\n[array]\ndriver = '
SCENES = (
    START + '"simulated"\n[calibration]\nfile = "{1}"\n',
    START + '"serial"\nport = "{0}/no"\ndescriptor = "{1}"\n',
    START + '"file"\npath = "{0}/a.csv"\nlayout = "{1}"\n',
)

COMMANDS = [
    *((command, suffix) for suffix in RECORDINGS for command in (
        ("replay", "{1}"), ("view", "{1}"), ("lerobot", "{1}", "{0}/out"),
        ("recover", "{1}", "{0}/out.npz"),
    )),
    *((("probe", driver, "--set", "path={1}"), suffix) for driver, suffix in (
        ("mcap", ".mcap"), ("npz", ".npz"), ("file", ".csv"), ("file", ".npy"), ("file", ".npz"),
    )),
    *((("templates", verb, "{1}"), suffix) for verb in ("show", "check", "design", "audit")
      for suffix in (".toml", ".tem")),
    (("templates", "import", "{1}"), ".m"),
    (("templates", "export", "{1}", "{0}/out.tem"), ".toml"),
    (("calibrate", "{1}", "--youngs-modulus", "1e6"), ".csv"),
    (("run", "{1}"), ".toml"),
    (("plan", "{1}"), ".toml"),
    (("sweep", "{1}"), ".toml"),
    (("simulate", "--pty", "--descriptor", "{1}"), ".toml"),
    (PICTURE, ".png"),
]  # fmt: skip

CALLS = {
    "load_recording": cnnum.load_recording,
    "load_template": cnnum.load_template,
    "load_picture": cnnum.load_picture,
    "load_scene": cnnum.load_scene,
    "Calibration.load": Calibration.load,
}


def ring(*_):
    raise TimeoutError


@pytest.fixture
def limit():
    before = signal.signal(signal.SIGALRM, ring)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def odd(folder, kind, suffix):
    target = folder / f"{kind}{suffix}"
    if kind == "pipe":
        os.mkfifo(target)
    else:
        target.symlink_to("/dev/zero")  # a device that never ends
    return target


def test_commands_never_wait_for_a_pipe(faults, limit, tmp_path):
    """A pipe or a device in the place of any file that a command reads is one sentence, exit 2."""
    (tmp_path / "a.csv").write_text("t,a\n0,1\n")
    scenes = [(("plan", "{0}/scene.toml"), ".toml", text) for text in SCENES]
    cases = [
        (kind, *case)
        for kind in ("pipe", "device")
        for case in (*((*case, "") for case in COMMANDS), *scenes)
    ]
    for number, (kind, words, suffix, text) in enumerate(faults.each(cases, short=len(cases))):
        folder = tmp_path / str(number)
        folder.mkdir()
        target = odd(folder, kind, suffix)
        if text:
            (folder / "scene.toml").write_text(text.format(tmp_path, target))
        signal.alarm(SECONDS)
        done = CliRunner().invoke(main, [word.format(folder, target) for word in words])
        signal.alarm(0)
        said = done.stderr.strip().splitlines()
        if done.exit_code != 2 or len(said) != 1 or isinstance(done.exception, TimeoutError):
            faults.lose(f"{' '.join(words)} with a {kind} {suffix}: {done.exit_code} {said[-3:]}")


def test_calls_never_wait_for_a_pipe(faults, limit, tmp_path):
    """The same of functions: a leaf of CnnumError."""
    suffixes = {"load_recording": RECORDINGS, "load_template": (".toml", ".tem", ".m")}
    cases = [
        (name, suffix, kind)
        for name in CALLS
        for suffix in suffixes.get(name, (".toml", ".png"))
        for kind in ("pipe", "device")
    ]
    for number, (name, suffix, kind) in enumerate(faults.each(cases, short=len(cases))):
        folder = tmp_path / str(number)
        folder.mkdir()
        signal.alarm(SECONDS)
        try:
            CALLS[name](odd(folder, kind, suffix))
        except CnnumError:
            pass
        except BaseException as error:
            faults.lose(f"{name} of a {kind} {suffix}: {error!r}")
        else:
            faults.lose(f"{name} of a {kind} {suffix}: read")
        signal.alarm(0)
