"""Specifications of templates to design: TOML files with a table [design]."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import cast

import numpy as np

from cnnum.arrays import Floats
from cnnum.design.local_rules import Table, example_table, rule_table
from cnnum.errors import TemplateError
from cnnum.safety.names import checked_name
from cnnum.safety.reading import LARGEST, parse_toml, read_text
from cnnum.templating.files import toml_values as toml
from cnnum.templating.template import Initial

SIGNS: Mapping[str, float] = {"#": 1.0, "o": -1.0, ".": 0.0}
DESIGN = ("rule", "until", "avoid", "state", "boundary", "initial", "margin", "split")
PROOF = ("mismatch", "draws")
TOP = ("name", "description", "design", "example", "search", "learn")
SEARCH = ("like", "mismatch", "draws", "population", "generations", "restarts", "seed")
LEARN = ("like", "step", "duration", "enough", "restarts", "iterations", "seed")


@dataclass(frozen=True, slots=True)
class Spec:
    """The job of a template.

    Attributes
    ----------
    name, description : str
    rule : str
        In the language of checks; empty where examples say it.
    still : bool
        Whether the rule is applied until nothing changes.
    avoid, state : str
        As the check of a rule takes them.
    examples : tuple of (input, state or None, output)
    boundary : float or str
    initial : float or "input"
    margin : float
    split : bool
        Whether a sequence of templates will do.
    mismatch : tuple of float
        At which flips are counted.
    draws : int
    search : mapping
        Options of `cnnum.design.search.Search`, its form under "like"; empty where none is asked.
    learn : mapping
        Options of a `Lesson` and of `cnnum.design.learning.learn`, the form under "like"; empty
        where none is asked. The examples are the lesson, else pictures of the form's check.
    """

    name: str
    description: str = ""
    rule: str = ""
    still: bool = False
    avoid: str = ""
    state: str = ""
    examples: tuple[tuple[Floats, Floats | None, Floats], ...] = ()
    boundary: float | str = -1.0
    initial: Initial = 0.0
    margin: float = 1.0
    split: bool = False
    mismatch: tuple[float, ...] = field(default=(0.01, 0.05, 0.1))
    draws: int = 100
    search: Mapping[str, object] = field(default_factory=dict[str, object])
    learn: Mapping[str, object] = field(default_factory=dict[str, object])

    def __post_init__(self) -> None:
        checked_name("a template", self.name, TemplateError)
        if self.search and self.learn:
            raise TemplateError(
                f"The design '{self.name}' has both tables 'search' and 'learn': keep one of them."
            )
        if self.search or self.learn:
            return
        if bool(self.rule) == bool(self.examples):
            raise TemplateError(
                f"The design '{self.name}' needs a rule or examples, one of them: write "
                '[design] rule = "…", or tables [[example]].'
            )
        if not self.margin > 0.0 or self.draws < 1 or any(m < 0.0 for m in self.mismatch):
            raise TemplateError(
                f"The design '{self.name}' needs a margin above 0, mismatches from 0 up and at "
                f"least one draw, got {self.margin:g}, {list(self.mismatch)} and {self.draws}."
            )

    def table(self) -> Table:
        """Return the local rule.

        Raises
        ------
        TemplateError
            If there is no such name.
        """
        if self.rule:
            return rule_table(self.rule, still=self.still, avoid=self.avoid, name=self.name)
        return example_table(self.examples, self.boundary)


def is_spec(path: str | PathLike[str]) -> bool:
    """Return whether a file is a specification; an unreadable one is none."""
    try:
        return bool(
            {"design", "search", "learn"} & parse_toml(read_text(Path(path), most=LARGEST)).keys()
        )
    except (OSError, ValueError):
        return False


def load_spec(path: str | PathLike[str]) -> Spec:
    """Return the specification that a file holds; it raises as `load_experiment`."""
    source = Path(path)
    return _spec(str(source), toml.read_table("design", source))


def _spec(file: str, content: dict[str, object]) -> Spec:
    toml.refuse_unknown(file, content, TOP)
    if "name" not in content:
        raise TemplateError(f"'{file}': the key 'name' is missing; every template needs it.")
    asked = toml.table(file, "design", content.get("design", {}))
    toml.refuse_unknown(file, asked, (*DESIGN, *PROOF))
    values: dict[str, object] = {"name": toml.text(file, "name", content["name"])}
    readers = {
        "rule": toml.text,
        "avoid": toml.text,
        "state": toml.text,
        "boundary": toml.number_or_text,
    }
    readers |= {
        "initial": toml.number_or_text,
        "margin": toml.number,
        "split": toml.flag,
        "draws": toml.whole,
    }
    values |= {
        key: read(file, f"design.{key}", asked[key])
        for key, read in readers.items()
        if key in asked
    }
    if "description" in content:
        values["description"] = toml.text(file, "description", content["description"])
    if "until" in asked:
        values["still"] = _until(file, asked["until"])
    if "mismatch" in asked:
        values["mismatch"] = _numbers(file, "design.mismatch", asked["mismatch"])
    for key, keys in (("search", SEARCH), ("learn", LEARN)):
        if key in content:
            values[key] = _options(file, key, keys, toml.table(file, key, content[key]))
    listed = content.get("example", [])
    rows = cast("list[object]", listed) if isinstance(listed, list) else [listed]
    values["examples"] = tuple(_example(file, toml.table(file, "example", row)) for row in rows)
    return Spec(**values)  # type: ignore[arg-type]


def _options(
    file: str, job: str, keys: Sequence[str], found: dict[str, object]
) -> dict[str, object]:
    toml.refuse_unknown(file, found, keys)
    measures = dict.fromkeys(("mismatch", "step", "duration", "enough"), toml.number)
    readers = dict.fromkeys(keys, toml.whole) | {"like": toml.text} | measures
    if "like" not in found:
        raise TemplateError(
            f"'{file}': the key '{job}.like' is missing: name the template whose form is used."
        )
    return {key: readers[key](file, f"{job}.{key}", value) for key, value in found.items()}


def _until(file: str, value: object) -> bool:
    if value not in ("once", "still"):
        raise toml.wrong(file, "design.until", "'once' or 'still'", value)
    return value == "still"


def _numbers(file: str, key: str, value: object) -> tuple[float, ...]:
    rows = cast("list[object]", value) if isinstance(value, list) else [value]
    return tuple(toml.number(file, key, row) for row in rows)


def _example(file: str, found: dict[str, object]) -> tuple[Floats, Floats | None, Floats]:
    toml.refuse_unknown(file, found, ("input", "state", "output"))
    for key in ("input", "output"):
        if key not in found:
            raise TemplateError(f"'{file}': an [[example]] needs the key '{key}'.")
    given = {key: _picture(file, f"example.{key}", value) for key, value in found.items()}
    if len({picture.shape for picture in given.values()}) > 1:
        raise TemplateError(f"'{file}': the pictures of an [[example]] must have the same size.")
    return given["input"], given.get("state"), given["output"]


def _picture(file: str, key: str, value: object) -> Floats:
    rows = toml.names(file, key, value)
    if len({len(row) for row in rows}) != 1 or set("".join(rows)) - SIGNS.keys() or not rows[0]:
        raise toml.wrong(file, key, "rows of '#', 'o' and '.', of one length", value)
    return np.array([[SIGNS[sign] for sign in row] for row in rows])
