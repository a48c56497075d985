"""How many templates with one wrong weight still pass `cnnum templates check`, and why.

`python -m docs.figures.changed_weights [NAMES]... [--digital] [--linear] [--by 1.2] [--out FOLDER]`
multiplies each number by 1.2, one at a time: those of A, B and z, and without `--linear` those of
nonlinear and delayed couplings, and of function tables. With `--digital` it leaves out templates
with a gray answer, which take most of the time. It counts the changed templates that pass

* the check of the function alone,
* the same, and end in the states that were measured,
* the same, and have the margin and the settle time that were measured,
* the same, and have the digest of the measured numbers.

With `--out` the changed templates are written, each with the measured table of the right one.
`cnnum templates check FOLDER` can then be pointed at them.
"""

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cnnum.engine import Engine
from cnnum.errors import CnnumError
from cnnum.templating.checks import run_check
from cnnum.templating.checks.registry import form_of
from cnnum.templating.files import Entry, save_entry, write_measured
from cnnum.templating.library import get_entry, template_names
from cnnum.templating.numbers import numbers_of, with_numbers
from cnnum.templating.template import Template

STAGES = ("function", "and end state", "and margin, settle time", "and digest")

LINEAR = ("A", "B", "z")


def changed(
    template: Template, factor: float, *, linear: bool = False
) -> Iterator[tuple[str, Template]]:
    """Yield the template with each number that is not 0 times the factor."""
    for part, array in numbers_of(template).items():
        if linear and part not in LINEAR:
            continue
        for place in np.argwhere(array):
            wrong = array.copy()
            wrong[tuple(place)] *= factor
            label = "_".join([part.replace(" ", ""), *map(str, place.tolist())])
            yield label, with_numbers(template, {part: wrong})


def stage(template: Template, entry: Entry, engine: Engine) -> int:
    """Return how many of the stages a changed template passes, in their order."""
    assert entry.measured is not None
    known = replace(entry.measured, digest=template.digest)
    ways: tuple[dict[str, Any], ...] = (
        {}, {"measured": known}, {"measured": known, "thorough": True},
    )  # fmt: skip
    for number, way in enumerate(ways):
        try:
            if not run_check(template, engine, repeats=0, **way).passed:
                return number
        except CnnumError:
            return number  # it diverges
    return 3 + (template.digest == entry.measured.digest)


def main() -> None:
    """Count, and print one line a stage and one a closed form."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("names", nargs="*")
    arguments.add_argument("--digital", action="store_true")
    arguments.add_argument("--linear", action="store_true")
    arguments.add_argument("--by", type=float, default=1.2)
    arguments.add_argument("--out", type=Path)
    given = arguments.parse_args()
    engine, passed, survivors = Engine("numba"), Counter[int](), Counter[str]()
    for name in given.names or template_names():
        entry = get_entry(name)
        if given.digital and not form_of(entry.template).digital:
            continue
        for label, template in changed(entry.template, given.by, linear=given.linear):
            reached = stage(template, entry, engine)
            passed[reached] += 1
            check = template.check
            survivors[check.name if check else ""] += reached >= 3
            if given.out is not None:
                given.out.mkdir(parents=True, exist_ok=True)
                path = given.out / f"{name}_{label}.toml"
                save_entry(replace(entry, template=template), path, force=True)
                if entry.measured is not None:
                    write_measured(path, entry.measured)
    total = passed.total()
    print(f"{total} templates with one number times {given.by:g}; of them pass")
    for number, text in enumerate(STAGES, 1):
        print(f"  {sum(count for at, count in passed.items() if at >= number):5d}  {text}")
    print("Without the digest, those that pass everything else, by closed form:")
    for form, count in survivors.most_common():
        if count:
            print(f"  {count:5d}  {form}")


if __name__ == "__main__":
    main()
