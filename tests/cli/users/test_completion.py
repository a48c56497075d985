"""The Tab key, as the shells ask for it: names of templates, programs and scenes, and files."""

import os
import subprocess
import sys

import pytest

import cnnum


def completions(line):
    """What bash is given for the last word of a line."""
    place = str(line.count(" "))
    asked = {"_CNNUM_COMPLETE": "bash_complete", "COMP_WORDS": line, "COMP_CWORD": place}
    code = "from cnnum.cli import main; import sys; sys.argv[0] = 'cnnum'; main()"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **asked}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return set(done.stdout.split())


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("cnnum templates show LOGA", {n for n in cnnum.template_names() if n[:4] == "LOGA"}),
        ("cnnum templates show edg", {n for n in cnnum.template_names() if n[:3].lower() == "edg"}),
        ("cnnum export tw", {"twist"}),
        ("cnnum run s", {n for n in cnnum.scene_names() if n[0] == "s"}),
        ("cnnum view ", set(cnnum.scene_names())),
    ],
)
def test_names_are_completed(line, wanted):
    found = completions(line)
    assert wanted
    assert found == {f"plain,{name}" for name in wanted}


def test_where_no_name_fits_files_are_completed():
    assert completions("cnnum run ./my") == {"file,./my"}
    assert completions("cnnum export ./my") == set()
