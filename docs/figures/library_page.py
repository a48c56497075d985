"""The page of the template library; `python docs/figures/library_page.py` writes it anew.

It writes `docs/template-library.md` from the template files. A test holds the page to them.
"""

from collections import defaultdict
from pathlib import Path

from cnnum.templating.checks.measuring import SIDES
from cnnum.templating.files import Entry
from cnnum.templating.library import get_entry, template_names, template_path

PAGE = Path(__file__).parents[1] / "template-library.md"


HEAD = """# The template library

{count} templates: the classic ones of the CNN Software Library, MatCNN, CNNSim and others, and
those of this project. The numbers of the classic ones were read in the named files. They are the
published ones, but for one sign each in HORSKELR and VERSKELB, whose notes say so. Each template is
one TOML file: its numbers, source, boundary, initial state and duration, the meaning of input and
state. The file also holds the check that the template must pass, and its measured figures.

* `cnnum templates gallery` writes one searchable page with pictures of each along its run.
* `cnnum templates check` runs every check on every engine; `NAMES` may be files and folders.
* `cnnum templates audit` counts the wrong cells with the boundaries 0, -1 and zero-flux.
* `cnnum templates measure` writes the figures of the tables below into the files.

*Settles*: time constants until the outputs rest, on squares of 8, 12 and 16 cells. A fixed duration
is run twice as long, to see the rest. For a missing time, `cnnum templates show NAME` says why.
*Margin*: how much may be added to the bias, and taken from it, with no wrong cell at the end of the
run. A gray answer has none. Both are of the pictures of the check, on which an uncoupled template
meets every neighbourhood; a wave with a longer way to go takes longer.

## One wrong weight

`python -m docs.figures.changed_weights` multiplies each number by 1.2, one at a time: those of A, B
and z, of couplings, and of tables. Of 1,272 changed templates whose answer is black and white,
these pass `cnnum templates check`:

| compared | pass |
|---|---|
| the function alone | 992 |
| and the end state | 544 |
| and margin and settle time | 68 |
| and the digest of the numbers | 0 |

The function alone lets most of them pass, since a fifth of one weight seldom turns a cell. A margin
that moves by more than 5 % tells them, as uncoupled templates meet every neighbourhood. A gray
answer has no margin. Where its check solves the template's own equation, wrong weight included, the
digest alone sees a weight that moves the mean end state by less than 0.02.

With `--out FOLDER` it writes the changed templates, and
`cnnum templates check FOLDER` fails all of them by their digest.
`cnnum templates design NAME --weights` shows of each weight how far it may go.

## Experimental templates

Of {experimental} templates ({share:.1f} %) no check shows that they do their job. Most of them are
checked against a refined solution of their own equation: an engine runs them right, no more.

| template | why |
|---|---|
{reasons}
"""


def page() -> str:
    """Return the page."""
    entries = {name: get_entry(name) for name in template_names()}
    groups = defaultdict[str, list[Entry]](list)
    for name, entry in entries.items():
        groups[template_path(name).parent.name].append(entry)
    doubtful = [entry for entry in entries.values() if entry.about.experimental]
    head = HEAD.format(
        count=len(entries),
        experimental=len(doubtful),
        share=100.0 * len(doubtful) / len(entries),
        reasons="\n".join(
            f"| {e.template.name} | {_line(e.about.experimental)} |" for e in doubtful
        ),
    )
    return head + "".join(_group(folder, groups[folder]) for folder in sorted(groups))


def _group(folder: str, entries: list[Entry]) -> str:
    rows = "\n".join(_row(entry) for entry in entries)
    return f"""
## {folder}

| template | purpose | check | settles (τ) | margin |
|---|---|---|---|---|
{rows}
"""


def _row(entry: Entry) -> str:
    template, measured, check = entry.template, entry.measured, entry.template.check
    first, stop, _ = _line(template.description).partition(". ")
    known = dict(measured.settle) if measured else {}
    times = ", ".join(f"{known[side]:g}" if side in known else "–" for side in SIDES if known)
    margin = "" if measured is None or measured.margin is None else f"{measured.margin:g}"
    cells = (template.name, first + stop.strip(), check.name if check else "", times, margin)
    return f"| {' | '.join(cells)} |"


def _line(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
