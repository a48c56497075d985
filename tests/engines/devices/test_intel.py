"""Intel's runtime is offered to the loader beside all else, and a user's folder stands."""

import os
from pathlib import Path

from cnnum.engines.devices import intel


def test_the_loader_finds_it_beside_all_else(tmp_path, monkeypatch):
    vendors = tmp_path / "vendors"
    vendors.mkdir()
    (vendors / "own.icd").write_text("libown.so\n")
    library = tmp_path / "lib" / "libintelocl.so"
    monkeypatch.setattr(intel, "VENDORS", vendors)
    monkeypatch.setattr(intel, "runtime", lambda: library)
    monkeypatch.delenv(intel.VARIABLE, raising=False)
    with intel.offered():
        folder = Path(os.environ[intel.VARIABLE])
        named = sorted(file.read_text().strip() for file in folder.glob("*.icd"))
        assert named == [str(library), "libown.so"]
    assert intel.VARIABLE not in os.environ
    assert not folder.exists()


def test_a_folder_of_the_users_own_stands(monkeypatch):
    monkeypatch.setattr(intel, "runtime", lambda: Path("libintelocl.so"))
    monkeypatch.setenv(intel.VARIABLE, "own")
    with intel.offered():
        assert os.environ[intel.VARIABLE] == "own"


def test_without_it_nothing_changes(monkeypatch):
    monkeypatch.setattr(intel, "runtime", lambda: None)
    monkeypatch.delenv(intel.VARIABLE, raising=False)
    with intel.offered():
        assert intel.VARIABLE not in os.environ
