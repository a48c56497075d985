"""Intel's runtime is offered to the loader beside all else, and a user's folder stands."""

import os
from pathlib import Path

from cnnum.engines.devices import listing


def test_the_loader_finds_it_beside_all_else(tmp_path, monkeypatch):
    vendors = tmp_path / "vendors"
    vendors.mkdir()
    (vendors / "own.icd").write_text("libown.so\n")
    library = tmp_path / "lib" / "libintelocl.so"
    monkeypatch.setattr(listing, "USUAL_VENDORS", vendors)
    monkeypatch.setattr(listing, "intel_runtime", lambda: library)
    monkeypatch.delenv(listing.VENDORS_VARIABLE, raising=False)
    with listing.intel_offered():
        folder = Path(os.environ[listing.VENDORS_VARIABLE])
        named = sorted(file.read_text().strip() for file in folder.glob("*.icd"))
        assert named == [str(library), "libown.so"]
    assert listing.VENDORS_VARIABLE not in os.environ
    assert not folder.exists()


def test_a_folder_of_the_users_own_stands(monkeypatch):
    monkeypatch.setattr(listing, "intel_runtime", lambda: Path("libintelocl.so"))
    monkeypatch.setenv(listing.VENDORS_VARIABLE, "own")
    with listing.intel_offered():
        assert os.environ[listing.VENDORS_VARIABLE] == "own"


def test_without_it_nothing_changes(monkeypatch):
    monkeypatch.setattr(listing, "intel_runtime", lambda: None)
    monkeypatch.delenv(listing.VENDORS_VARIABLE, raising=False)
    with listing.intel_offered():
        assert listing.VENDORS_VARIABLE not in os.environ
