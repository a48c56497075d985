"""Templates designed from a specification, and the specification as a file."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.design.learning import Lesson, learn
from cnnum.design.linear_program import (
    Conflict,
    Shape,
    Weights,
    as_template,
    equalities,
    separate,
    separate_wide,
    settle_bound,
)
from cnnum.design.local_rules import (
    Seen,
    Table,
    WideRule,
    check_of,
    example_table,
    rule_table,
)
from cnnum.design.search import Search, Watch, go_on, search
from cnnum.design.worst_case import worst_case
from cnnum.errors import MethodError, TemplateError
from cnnum.safety.reading import LARGEST, parse_toml, read_text
from cnnum.safety.values import checked_name
from cnnum.templating.checks.registry import form_of
from cnnum.templating.checks.robustness import flips
from cnnum.templating.checks.rules import reads_wide
from cnnum.templating.checks.running import Engine, measure
from cnnum.templating.files import toml_values as toml
from cnnum.templating.files.entry import About, Entry, FlipRate, Proof
from cnnum.templating.library import get_template
from cnnum.templating.template import Check, Initial, Template

SIGNS: Mapping[str, float] = {"#": 1.0, "o": -1.0, ".": 0.0}
DESIGN = ("rule", "until", "avoid", "state", "boundary", "initial", "margin", "split")
PROOF = ("mismatch", "draws")
TOP = ("name", "description", "design", "example", "search", "learn")
SEARCH = ("like", "mismatch", "draws", "population", "generations", "restarts", "seed")
LEARN = ("like", "step", "duration", "enough", "restarts", "iterations", "seed")


@dataclass(frozen=True, slots=True)
class Spec:
    """Specification of a template.

    Attributes
    ----------
    name, description : str
    rule : str
        Rule in the language of checks; empty if there are examples instead.
    still : bool
        Whether the rule is applied until nothing changes.
    avoid, state : str
        Parameters of the check of a rule.
    examples : tuple of (input, state or None, output)
    boundary : float or str
    initial : float or "input"
    margin : float
    split : bool
        Whether a sequence of templates is allowed.
    mismatch : tuple of float
        Mismatches for which flips are counted.
    draws : int
    search : mapping
        Options of `cnnum.design.search.Search`, with its form under "like"; empty for no search.
    learn : mapping
        Options of a `Lesson` and of `cnnum.design.learning.learn`, with the form under "like";
        empty for no learning. The training pictures are the examples, or pictures from the check
        of the form if there are none.
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
                f"The design '{self.name}' needs either a rule or examples: write [design] rule = "
                '"…", or tables [[example]].'
            )
        if not self.margin > 0.0 or self.draws < 1 or any(m < 0.0 for m in self.mismatch):
            raise TemplateError(
                f"The design '{self.name}' needs a positive margin, non-negative mismatches and "
                f"at least one draw, got {self.margin:g}, {list(self.mismatch)} and {self.draws}."
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
    """Return whether a file is a specification; false if it cannot be read."""
    try:
        return bool(
            {"design", "search", "learn"} & parse_toml(read_text(Path(path), most=LARGEST)).keys()
        )
    except (OSError, ValueError):
        return False


def load_spec(path: str | PathLike[str]) -> Spec:
    """Load a specification from a file; errors are those of `load_experiment`."""
    source = Path(path)
    return _spec(str(source), toml.read_table("design", source))


def _spec(file: str, content: dict[str, object]) -> Spec:
    toml.refuse_unknown(file, content, TOP)
    if "name" not in content:
        raise TemplateError(f"'{file}': the key 'name' is missing; every template needs it.")
    section = toml.table(file, "design", content.get("design", {}))
    toml.refuse_unknown(file, section, (*DESIGN, *PROOF))
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
        key: read(file, f"design.{key}", section[key])
        for key, read in readers.items()
        if key in section
    }
    if "description" in content:
        values["description"] = toml.text(file, "description", content["description"])
    if "until" in section:
        values["still"] = _until(file, section["until"])
    if "mismatch" in section:
        values["mismatch"] = _numbers(file, "design.mismatch", section["mismatch"])
    for key, keys in (("search", SEARCH), ("learn", LEARN)):
        if key in content:
            values[key] = _options(file, key, keys, toml.table(file, key, content[key]))
    listed = content.get("example", [])
    rows = cast("list[object]", listed) if isinstance(listed, list) else [listed]
    values["examples"] = tuple(_example(file, toml.table(file, "example", row)) for row in rows)
    return Spec(**values)  # type: ignore[arg-type]


def _options(
    file: str, job: str, keys: Sequence[str], values: dict[str, object]
) -> dict[str, object]:
    toml.refuse_unknown(file, values, keys)
    measures = dict.fromkeys(("mismatch", "step", "duration", "enough"), toml.number)
    readers = dict.fromkeys(keys, toml.whole) | {"like": toml.text} | measures
    if "like" not in values:
        raise TemplateError(
            f"'{file}': the key '{job}.like' is missing: name the template whose form is used."
        )
    return {key: readers[key](file, f"{job}.{key}", value) for key, value in values.items()}


def _until(file: str, value: object) -> bool:
    if value not in ("once", "still"):
        raise toml.wrong(file, "design.until", "'once' or 'still'", value)
    return value == "still"


def _numbers(file: str, key: str, value: object) -> tuple[float, ...]:
    rows = cast("list[object]", value) if isinstance(value, list) else [value]
    return tuple(toml.number(file, key, row) for row in rows)


def _example(file: str, values: dict[str, object]) -> tuple[Floats, Floats | None, Floats]:
    toml.refuse_unknown(file, values, ("input", "state", "output"))
    for key in ("input", "output"):
        if key not in values:
            raise TemplateError(f"'{file}': an [[example]] needs the key '{key}'.")
    given = {key: _picture(file, f"example.{key}", value) for key, value in values.items()}
    if len({picture.shape for picture in given.values()}) > 1:
        raise TemplateError(f"'{file}': the pictures of an [[example]] must have the same size.")
    return given["input"], given.get("state"), given["output"]


def _picture(file: str, key: str, value: object) -> Floats:
    rows = toml.names(file, key, value)
    if len({len(row) for row in rows}) != 1 or set("".join(rows)) - SIGNS.keys() or not rows[0]:
        raise toml.wrong(file, key, "rows of '#', 'o' and '.', of one length", value)
    return np.array([[SIGNS[sign] for sign in row] for row in rows])


MOST = 12
"""Largest number of templates in a sequence."""

BEYOND = 1e-6


def sequence(table: Table) -> tuple[tuple[Weights, Table], ...]:
    """Return the weights of templates that together implement a rule, in order.

    The number of templates is not proven to be minimal.

    Parameters
    ----------
    table : Table
        Of the input alone.

    Raises
    ------
    TemplateError
        If the rule reads more than the input, or takes more than twelve templates.
    """
    if any(seen.source != "u" for seen in table.seen):
        raise TemplateError(
            "A rule that reads outputs or the previous state cannot be split, because its "
            "templates would need the state to pass on their results: write it as rules of "
            "the input."
        )
    # a rule that a turn leaves as it is may need planes that it does not
    ways = [way for even in (True, False) if (way := _peeled(table, symmetric=even)) is not None]
    if not ways:
        raise TemplateError(f"The rule needs more than {MOST} templates: split it by hand.")
    return min(ways, key=len)


def _peeled(table: Table, *, symmetric: bool) -> tuple[tuple[Weights, Table], ...] | None:
    result = list[tuple[Weights, Table]]()
    left = table
    while isinstance(weights := separate(left, symmetric=symmetric), Conflict):
        if len(result) == MOST - 1:
            return None
        step, left = _last(left, symmetric=symmetric)
        last = separate(step, symmetric=symmetric)
        assert isinstance(last, Weights)
        result.append((last, step))
    return ((weights, left), *reversed(result))


def answers(steps: tuple[tuple[Weights, Table], ...], table: Table) -> Floats:
    """Return the colour that a sequence gives to each configuration of a rule."""
    first, *others = steps
    colours = np.sign(first[0].sums(table))
    for weights, _ in others:
        carried = Table(
            (*table.seen, BEFORE), np.column_stack([table.signs, colours]), table.colours
        )
        colours = np.sign(weights.sums(carried))
    return np.asarray(colours, dtype=np.float64)


BEFORE = Seen("before")


def _last(table: Table, *, symmetric: bool) -> tuple[Table, Table]:
    """Return the rule of the last template, and the rest for those before it."""
    beyond = max(
        (_one_sided(table, colour, symmetric=symmetric) for colour in (-1.0, 1.0)),
        key=lambda cut: int(cut.sum()),
    )
    rest = Table(table.seen, table.signs[~beyond], table.colours[~beyond])
    # a cell beyond the plane has its colour, black or white before
    signs = np.vstack([table.signs[beyond], table.signs[beyond], rest.signs])
    count = int(beyond.sum())
    before = np.concatenate([np.ones(count), -np.ones(count), rest.colours])
    colours = np.concatenate([table.colours[beyond], table.colours[beyond], rest.colours])
    return Table((*table.seen, BEFORE), np.column_stack([signs, before]), colours), rest


def _one_sided(table: Table, colour: float, *, symmetric: bool) -> NDArray[np.bool_]:
    """Return the configurations of one colour that a plane cuts off from all of the other."""
    from scipy.optimize import linprog

    rows = np.column_stack([table.signs, np.ones(len(table.signs))])
    own, other = rows[table.colours == colour], rows[table.colours != colour]
    count, columns = own.shape
    equal = equalities(table, columns)[::2, :columns] if symmetric else np.zeros((0, columns))
    solution = linprog(
        np.concatenate([np.zeros(columns), np.ones(count)]),
        A_ub=np.vstack(
            [
                np.column_stack([-own, -np.eye(count)]),
                np.column_stack([other, np.zeros((len(other), count))]),
            ]
        ),
        b_ub=-np.ones(count + len(other)),
        A_eq=np.column_stack([equal, np.zeros((len(equal), count))]) if len(equal) else None,
        b_eq=np.zeros(len(equal)) if len(equal) else None,
        bounds=[(None, None)] * columns + [(0.0, None)] * count,
        method="highs",
    )
    sums = rows @ np.asarray(solution.x)[:columns]
    cut = sums > sums[table.colours != colour].max() + BEYOND
    return cut if cut.any() else _corner(table, colour)


def _corner(table: Table, colour: float) -> NDArray[np.bool_]:
    """Return one configuration of a colour: a corner of the cube, which a plane always cuts off."""
    cut = np.zeros(len(table.signs), dtype=bool)
    cut[np.flatnonzero(table.colours == colour)[0]] = True
    return cut


SEED, SHAPE = 1, (8, 8)
"""Of the pictures of a check; flips are counted on those of another seed."""

Example = tuple[Floats, Floats | None, Floats]


def lesson_of(form: Template, examples: Sequence[Example]) -> Lesson:
    """Return training pictures from examples or, if there are none, from the form's check.

    Parameters
    ----------
    form : Template
    examples : sequence of (input, state or None, output)
        Of one size.

    Raises
    ------
    TemplateError
        If examples differ in size, or the form has no check, or an unsuitable one.
    """
    if not examples:
        return _of_check(form)
    inputs, states, outputs = zip(*examples, strict=True)
    if (
        len({output.shape for output in outputs}) > 1
        or len({start is None for start in states}) > 1
    ):
        raise TemplateError(
            f"The examples for '{form.name}' must have one size, and either all or none must have "
            "a state."
        )
    state = None if states[0] is None else np.stack(states)
    return Lesson(form, np.stack(outputs), np.stack(inputs) if form.inputs else None, state)


def _of_check(form: Template) -> Lesson:
    rule = form_of(form)
    case = rule.cases(form, np.random.default_rng(SEED), SHAPE)
    others = (case.previous, case.bias, case.mask)
    if rule.compares != "output" or any(other is not None for other in others):
        raise TemplateError(
            f"The check of '{form.name}' involves more than inputs, states and outputs: give "
            "training pictures as tables [[example]]."
        )
    return Lesson(form, rule.expected(form, case), case.input, case.state)


PLACES = ("nw", "n", "ne", "w", "c", "e", "sw", "s", "se")
SOURCE = "found by CMA-ES: the fewest flips under mismatch"
LEARNED = "learned from labelled pictures by gradients"

NEAR = 0.1
"""Largest mean squared error of a learned template, as from 2.5 % of cells with a wrong colour."""

_CARRIED = "The state carries the result of the template before."


@dataclass(frozen=True, slots=True)
class Designed:
    """A template that was designed, with its weights, its rule and its record.

    Attributes
    ----------
    entry : Entry
        As the library keeps it.
    weights : Weights or None
    table : Table or None
        None of a search, or of gradients.
    """

    entry: Entry
    weights: Weights | None
    table: Table | None


def designed(spec: Spec, engine: Engine, watch: Watch = go_on) -> tuple[Designed, ...]:
    """Return the templates of a specification: one, or a sequence if it may be split.

    Parameters
    ----------
    spec : Spec
    engine : Engine
    watch : callable
        Is given the `Advance` of a long design, and says whether it goes on. Where it does not, a
        search or a lesson returns its best template so far.

    Raises
    ------
    TemplateError
        If no template meets the specification; the message gives the reason.
    """
    if spec.search:
        return (_searched(spec, engine, watch),)
    if spec.learn:
        return (_learned(spec, engine, watch),)
    return tuple(_proved(spec, engine, *part) for part in _parts(spec, watch))


def _searched(spec: Spec, engine: Engine, watch: Watch) -> Designed:
    """Return the template of a search, whose proof is counted and no bound."""
    options: dict[str, Any] = dict(spec.search)
    form = replace(get_template(str(options.pop("like"))), name=spec.name)
    result = search(Search(form, **options), engine, watch)
    return _counted(spec, engine, result.template, SOURCE, "search", result.evaluations)


def _learned(spec: Spec, engine: Engine, watch: Watch) -> Designed:
    """Return the template that gradients lead to, whose proof is counted and no bound."""
    options: dict[str, Any] = dict(spec.learn)
    form = replace(get_template(str(options.pop("like"))), name=spec.name)
    ways = {key: options.pop(key) for key in ("step", "duration") if key in options}
    lesson = replace(lesson_of(form, spec.examples), **ways)
    result = learn(lesson, **options, watch=watch)
    if result.loss > NEAR and not result.stopped:
        raise TemplateError(
            f"'{spec.name}' was not learned: the mean squared error ends at {result.loss:.3g}, "
            f"expected at most {NEAR:g}; use more restarts, or another form."
        )
    cells = int(np.asarray(lesson.target).size)
    return _counted(spec, engine, result.template, LEARNED, "gradients", cells)


def _counted(
    spec: Spec, engine: Engine, made: Template, source: str, method: str, examples: int
) -> Designed:
    template = replace(made, description=spec.description, source=source)
    measured = measure(template, engine)
    size = sum(float(np.abs(part).sum()) for part in (template.A, template.B, template.z))
    margin = measured.margin or 0.0
    rates = _rates(spec, template, engine)
    proof = Proof(
        template.digest, method, examples, margin, margin / size, flips=rates, **_worst(template)
    )
    entry = Entry(template, about=About(tags=("designed",)), measured=measured, proof=proof)
    return Designed(entry, None, None)


def _parts(spec: Spec, watch: Watch) -> Iterator[tuple[Template, Weights, Table]]:
    wide = reads_wide(spec.rule) and not (spec.still or spec.split)
    if wide:
        rule = WideRule(spec.rule, spec.avoid, spec.name)
        separation, table = separate_wide(rule, watch=watch)
    else:
        table = spec.table()
        separation = separate(table)
    if isinstance(separation, Weights):
        yield (
            _template(spec, spec.name, separation, spec.description, _check(spec, separation)),
            separation,
            table,
        )
        return
    if not spec.split:
        cure = (
            "set split = true in [design] for a sequence of templates, or enlarge the neighbourhood"
        )
        raise TemplateError(
            f"No single template computes '{spec.name}': {separation.why} ({_shown(separation)}); "
            f"{'write a sequence of rules that are linear sums' if wide else cure}."
        )
    steps = sequence(table)
    for n, (weights, part) in enumerate(steps, 1):
        text = f"Step {n} of {len(steps)} of {spec.name}. {_CARRIED if n > 1 else ''}".strip()
        check = check_of(as_rule(weights), still=False, avoid="", state=_state(part))
        name = f"{spec.name}_{n}"
        words = f"{spec.description} {text}".strip()
        yield _template(spec, name, weights, words, check), weights, part


def _template(spec: Spec, name: str, weights: Weights, description: str, check: Check) -> Template:
    before = any(seen.source == "before" for seen in weights.seen)
    initial = -1.0 if before and spec.initial == 0.0 else spec.initial
    shape = Shape(name, description, spec.boundary, initial, spec.margin, check)
    return as_template(weights, shape)


def _check(spec: Spec, weights: Weights) -> Check:
    state = spec.state or ("other" if any(s.source == "before" for s in weights.seen) else "")
    rule = spec.rule or as_rule(weights)
    return check_of(rule, still=spec.still, avoid=spec.avoid, state=state)


def _state(table: Table) -> str:
    return "other" if Seen("before") in table.seen else ""


def as_rule(weights: Weights) -> str:
    """Return weights as a rule of the language of checks: black where the sum is above 0."""
    black, white = list[str](), list[str]()
    level = float(weights.values.sum()) - weights.bias
    for seen, value in zip(weights.seen, weights.values.tolist(), strict=True):
        if value:
            place = PLACES[3 * (seen.down + 1) + seen.east + 1]
            name = "before" if seen.source == "before" else place
            (black if value > 0.0 else white).append(f"{2.0 * abs(value):.12g} * {name}")
    (black if level < 0.0 else white).append(f"{abs(level):.12g}")
    return f"{' + '.join(black) or '0'} > {' + '.join(white) or '0'}"


def _proved(
    spec: Spec, engine: Engine, template: Template, weights: Weights, table: Table
) -> Designed:
    rates = _rates(spec, template, engine)
    before = spec.margin * weights.of("before")
    coupled = any(seen.source == "y" for seen in weights.seen)
    proof = Proof(
        template.digest,
        "linear program",
        len(table.signs),
        float((table.colours * weights.sums(table)).min()) * spec.margin,
        weights.relative,
        weights.bound,
        None if coupled else settle_bound(spec.margin, before),
        flips=rates,
        **_worst(template),
    )
    entry = Entry(template, about=About(tags=("designed",)), proof=proof)
    return Designed(replace(entry, measured=measure(template, engine)), weights, table)


def _worst(template: Template) -> dict[str, Any]:
    """Return what a proof says of the worst mismatch of a template."""
    result = worst_case(template)
    if result is None:
        return {}
    return {"worst_case": result.share, "worst_case_weights": result.words}


def _rates(spec: Spec, template: Template, engine: Engine) -> tuple[FlipRate, ...]:
    counted = flips(template, engine, mismatches=spec.mismatch, bits=(), draws=spec.draws)
    for rate in counted:
        if not rate.draws:
            raise MethodError(f"No template of {rate.change} can be run: {rate.reason}")
    return tuple(
        FlipRate(width, rate.flipped, rate.low, rate.high, rate.draws)
        for width, rate in zip(spec.mismatch, counted, strict=True)
    )


def _place(seen: Seen) -> str:
    if seen.source == "before":
        return "before"
    near = max(abs(seen.down), abs(seen.east)) <= 1
    return PLACES[3 * (seen.down + 1) + seen.east + 1] if near else f"[{seen.down}, {seen.east}]"


def _shown(conflict: Conflict) -> str:
    """Return one neighbourhood of each colour, by the cells that it sees."""
    result = list[str]()
    for colour, word in ((1.0, "black"), (-1.0, "white")):
        signs = conflict.signs[np.flatnonzero(conflict.colours == colour)[0]]
        seen = " ".join(
            f"{_place(s)}={'#' if sign > 0.0 else 'o'}"
            for s, sign in zip(conflict.seen, signs, strict=True)
        )
        result.append(f"{word} at {seen}")
    return ", ".join(result)
