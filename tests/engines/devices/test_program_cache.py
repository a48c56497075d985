"""Built programs are kept while PoCL, in another thread or process, works in the same folder."""

import shutil

import pytest

program_cache = pytest.importorskip("cnnum.engines.devices.program_cache")


@pytest.fixture(autouse=True)
def no_timer_of_another_test():
    """What another test has built is kept by a timer, whose turn must not fall into these."""
    for timer in program_cache._TIMERS:
        timer.join()


def test_a_folder_that_goes_while_it_is_read_is_kept_the_next_time(tmp_path, monkeypatch):
    built, kept = tmp_path / "AB", {}
    built.mkdir()
    (built / "kernel.so").write_bytes(b"code")
    laid = program_cache._Laid(frozenset({built}), frozenset())
    monkeypatch.setattr(program_cache, "work_folder", lambda: tmp_path)
    monkeypatch.setattr(program_cache, "_PROGRAMS", {"entry": laid})
    monkeypatch.setattr(program_cache.Shelf, "put", lambda _, name, content: kept.update({name: 1}))
    packed = program_cache._packed

    def gone(files):
        shutil.rmtree(built)
        return packed(files)

    monkeypatch.setattr(program_cache, "_packed", gone)
    program_cache.keep_programs()
    assert (kept, laid.kept) == ({}, frozenset())

    built.mkdir()
    (built / "kernel.so").write_bytes(b"code")
    monkeypatch.setattr(program_cache, "_packed", packed)
    program_cache.keep_programs()
    assert (list(kept), laid.kept) == (["entry"], frozenset({"AB/kernel.so"}))


def test_the_timer_passes_over_old_programs_and_the_end_does_not(tmp_path, monkeypatch):
    kept, laid = [], {}
    for name, built in (("old", -program_cache.YOUNG_S - 1.0), ("young", 0.0)):
        folder = tmp_path / name / "plan"
        folder.mkdir(parents=True)
        (folder / "plan.so").write_bytes(b"code")
        laid[name] = program_cache._Laid(frozenset({tmp_path / name}), frozenset())
        laid[name].built += built
    monkeypatch.setattr(program_cache, "work_folder", lambda: tmp_path)
    monkeypatch.setattr(program_cache, "_PROGRAMS", laid)
    monkeypatch.setattr(program_cache.Shelf, "put", lambda _, name, content: kept.append(name))
    program_cache.keep_programs(program_cache.YOUNG_S)
    assert kept == ["young"]
    program_cache.keep_programs()
    assert kept == ["young", "old"]
    assert laid["old"].kept == {"old/plan/plan.so"}


def test_an_entry_is_for_the_place_where_the_driver_is_installed(monkeypatch):
    """PoCL names its programs by it: entries of many places together would grow with each."""
    (device, *_) = [d for p in program_cache.cl.get_platforms() for d in p.get_devices()]
    here = program_cache._name(device, "kernel", ["-w"])
    assert here == program_cache._name(device, "kernel", ["-w"])
    monkeypatch.setattr(program_cache.cl, "__file__", "/elsewhere/pyopencl/__init__.py")
    assert here != program_cache._name(device, "kernel", ["-w"])
