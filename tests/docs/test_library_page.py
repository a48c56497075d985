"""The page of the template library agrees with the template files."""

import importlib.util
import re
from pathlib import Path

from cnnum import template_names

SCRIPT = Path(__file__).parents[2] / "docs/figures/library_page.py"


def ranged(names):
    """Names from "SKELBW1 to SKELBW8", or a single name."""
    first, *last = re.split(r"\s+to\s+", names)
    if not last:
        return [first]
    (stem, low), (_, high) = (
        re.fullmatch(r"(\w*?)(\d+)", name).groups() for name in (first, *last)
    )
    return [f"{stem}{number}" for number in range(int(low), int(high) + 1)]


def test_the_page_is_that_of_the_files():
    spec = importlib.util.spec_from_file_location("library_page", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    written = module.PAGE.read_text(encoding="utf-8")
    assert written == module.page(), "run python docs/figures/library_page.py"
    rows = re.findall(r"^\* ([\w,\s]+):\s", written, re.MULTILINE)
    listed = {name for names in rows for part in re.split(r",\s+", names) for name in ranged(part)}
    assert set(template_names()) <= listed
