"""The page of the template library; `python docs/figures/library_page.py` writes it anew.

It writes `docs/template-library.md` from the template files. A test holds the page to them.
"""

import re
from collections import defaultdict
from pathlib import Path

from cnnum.templating.files import Entry
from cnnum.templating.library import get_entry, template_names, template_path

PAGE = Path(__file__).parents[1] / "template-library.md"


HEAD = """# The template library

The library has {count} templates: the classic ones of the CNN Software Library, MatCNN, CNNSim and
other sources, and those of this project. The classic ones have their published numbers, which were
read in the files that each template names; HORSKELR and VERSKELB differ in one sign, and their
notes say so.

The tables below give the purpose of each template. `cnnum templates show NAME` prints everything
else: the full definition, the numbers, the source, the boundary, what input and state mean, the
check that the template must pass, how long it takes to settle on squares of 8, 12 and 16 cells,
and how much the bias may change before a cell is wrong. These figures hold for the pictures of the
check. A wave that has further to go takes longer.

* `cnnum templates find` searches the library by words or by an example.
* `cnnum templates gallery` writes one searchable page with pictures of every template during its
  run.
* `cnnum templates check` runs the checks on all engines. It also takes files and folders of your
  own.
* `cnnum templates audit` counts the wrong cells under the boundaries 0, -1 and zero-flux.
* `cnnum templates design NAME --weights` shows how far each weight may move.

## What a check detects

A check compares the function of the template, its mean end state, its margin and settling time,
and a digest of its numbers. The function alone is a weak test, because changing one weight by 20 %
seldom turns a cell: of 1,272 black-and-white templates with one number multiplied by 1.2, 992
still compute the same function. 544 of them also keep their end state, 68 keep margin and settling
time as well, and none keeps the digest (`python -m docs.figures.changed_weights`).

## Experimental templates

For {experimental} templates ({share:.1f} %) no check shows that they do what their name promises.
Most of them are checked against a finer solution of their own equation, which only shows that the
engines integrate them correctly.

| templates | why |
|---|---|
{reasons}
"""


def page() -> str:
    """Return the page."""
    entries = {name: get_entry(name) for name in template_names()}
    groups = defaultdict[str, list[Entry]](list)
    doubtful = defaultdict[str, list[str]](list)
    for name, entry in entries.items():
        groups[template_path(name).parent.name].append(entry)
        if entry.about.experimental:
            why = re.split(r"[.] ", _line(entry.about.experimental), maxsplit=1)[0].rstrip(".")
            doubtful[why].append(name)
    count = sum(map(len, doubtful.values()))
    head = HEAD.format(
        count=len(entries),
        experimental=count,
        share=100.0 * count / len(entries),
        reasons="\n".join(f"| {', '.join(names)} | {why} |" for why, names in doubtful.items()),
    )
    return head + "".join(_group(folder, groups[folder]) for folder in sorted(groups))


def _group(folder: str, entries: list[Entry]) -> str:
    names = defaultdict[str, list[str]](list)
    for entry in entries:
        names[_purpose(entry)].append(entry.template.name)
    rows = "\n".join(f"| {', '.join(alike)} | {purpose} |" for purpose, alike in names.items())
    return f"""
## {folder}

| template | purpose |
|---|---|
{rows}
"""


def _purpose(entry: Entry) -> str:
    """Return the first clause of a description that says enough; `cnnum templates show` has all."""
    text = _line(entry.template.description)
    for ends in (r"[,.:;] |[.]$", r"[.:;] |[.]$", r"[.;] |[.]$"):
        clause = re.split(ends, text, maxsplit=1)[0]
        if len(clause.split()) > 4:
            break
    return re.sub(r"^Step (\d) of 8\b", "One of eight steps", clause)


def _line(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
