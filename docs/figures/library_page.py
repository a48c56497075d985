"""Write the page of the template library: `python docs/figures/library_page.py`.

`docs/template-library.md` is written from the template files; a test compares the two.
"""

import re
import textwrap
from collections import defaultdict
from pathlib import Path

from cnnum.templating.files import Entry
from cnnum.templating.library import get_entry, template_names, template_path

PAGE = Path(__file__).parents[1] / "template-library.md"

HEAD = """# The template library

The library has {count} templates, from the CNN Software Library, MatCNN, CNNSim, other sources and
this project. Published weights are unchanged, except for one sign each in HORSKELR and VERSKELB.
`cnnum templates show NAME` prints the definition of a template, its source, the meaning of its
input and state, its check, the settling time on the check's pictures, and its margin: how much the
bias may change before a cell ends in the wrong state. Lower-case section titles are folders of the
library. Other commands of `cnnum templates`:

| command | what it does |
|---|---|
| `find` | searches the library by words or by an example picture with the desired output |
| `gallery` | writes a page with pictures of every template; with `--live`, you can draw on it |
| `check` | runs the checks of the library, or of your own template files, on all engines |
| `audit` | counts the cells that each template gets wrong with the boundaries 0, -1 and zero-flux |
| `design NAME --weights` | shows how far a weight may change until a cell ends in the wrong state |

A check tests not only what a template computes, but also its mean final state, margin and settling
time. A test of the function alone would be weak: multiplying one number of a black-and-white
template by 1.2 gives 1,272 variants, of which 992 still compute the function of the original, but
only 68 also keep its final state, margin and settling time (`python -m
docs.figures.changed_weights --digital`).

## Experimental templates

For {experimental} templates ({share:.1f} %), no check shows that they do what their name promises;
most of their checks show only that the equation is integrated correctly. `cnnum templates show
NAME` says what is missing.

{doubtful}
"""


def page() -> str:
    """Return the page."""
    entries = {name: get_entry(name) for name in template_names()}
    groups = defaultdict[str, list[Entry]](list)
    doubtful = list[str]()
    for name, entry in entries.items():
        groups[template_path(name).parent.name].append(entry)
        if entry.about.experimental:
            doubtful.append(name)
    head = HEAD.format(
        count=len(entries),
        experimental=len(doubtful),
        share=100.0 * len(doubtful) / len(entries),
        doubtful=textwrap.fill(f"{_names(doubtful)}.", 100, break_on_hyphens=False),
    )
    return head + "".join(_group(folder, groups[folder]) for folder in sorted(groups))


def _group(folder: str, entries: list[Entry]) -> str:
    names = defaultdict[str, list[str]](list)
    for entry in entries:
        names[_purpose(entry)].append(entry.template.name)
    rows = "\n".join(_item(f"{_names(alike)}: {purpose}") for purpose, alike in names.items())
    return f"\n## {folder}\n\n{rows}\n"


def _names(names: list[str]) -> str:
    """Return names one after the other, and three or more with numbers in a row as a range."""
    runs: list[list[str]] = []
    for name in names:
        stem, number = name.rstrip("0123456789"), name[len(name.rstrip("0123456789")) :]
        follows = runs and number and runs[-1][-1] == f"{stem}{int(number) - 1}"
        if follows:
            runs[-1].append(name)
        else:
            runs.append([name])
    return ", ".join(f"{r[0]} to {r[-1]}" if len(r) > 2 else ", ".join(r) for r in runs)


def _item(text: str) -> str:
    return textwrap.fill(f"* {text}", 100, subsequent_indent="  ", break_on_hyphens=False)


def _purpose(entry: Entry) -> str:
    """Return the first clause of a description; `cnnum templates show` has all of it."""
    text = re.sub(r" \([^()]*\)(?!/)| from any state.*", "", _line(entry.template.description))
    text = re.sub(r"^Step (\d) of 8\b", "One of eight steps", text)
    ends = [found.start() for found in re.finditer(r"[,.:;] |[.]$|(?<!from) where ", text)]
    return next((text[:end] for end in ends if " " in text[:end]), text).rstrip(",")


def _line(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
