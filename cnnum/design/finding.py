"""Templates found in the library: by words, by an example of what one should do, and compared."""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.errors import ArrayError, CnnumError, name_error
from cnnum.integrators.stability import stability_bound
from cnnum.templating.library import get_entry, template_names
from cnnum.templating.stability_class import stability_class
from cnnum.templating.template import Template

RELATED = (
    ("edge", "sobel", "prewitt", "canny", "gradient", "contour", "outline", "boundary"),
    ("skeleton", "thinning", "thin", "medial"),
    ("hole", "fill", "filler", "flood"),
    ("smooth", "blur", "gaussian", "denoise", "noise", "average", "lowpass"),
    ("erosion", "erode", "shrink"),
    ("dilation", "dilate", "grow", "thicken"),
    ("threshold", "binarise", "binarize", "binary"),
    ("invert", "inversion", "not", "negative", "complement"),
    ("laplace", "laplacian", "diffusion", "heat"),
    ("halftone", "halftoning", "dither", "dithering"),
    ("motion", "move", "moving", "movement", "speed", "velocity"),
    ("corner", "vertex", "convex"),
    ("label", "connected", "component", "connectivity"),
    ("peak", "maximum", "maxima", "extreme"),
    ("majority", "vote", "voting"),
    ("median", "rank"),
    ("line", "stroke", "bar"),
    ("isolated", "point", "dot", "speckle", "pepper"),
)
"""Words that people use for the same thing, of picture processing and of the field."""

WHOLE, NAME, TAG, FIRST, TEXT = 8.0, 4.0, 3.0, 2.0, 1.0
"""Weights of a word that is a template's name, or stands in it or in an alias, in its tags, in its
first sentence, and in the rest."""

KIN = 0.5
"""Weight of a related word, as a share of that of the word itself."""

LEFT_OUT = frozenset(
    ["a", "an", "the", "of", "in", "on", "to", "is", "are", "that", "with", "it", "for"]
)

PICTURES, SIDE = 8, 24
"""Random pictures on which coupled templates are compared, and their side in cells."""

FIRST_LOOK, LAST_LOOK = 32.0, 1024.0
"""Time constants after which the signs of a run without a duration are looked at, and after which
it counts as at rest whatever they do."""

STEP = 0.1
"""Longest fixed step of a search, in time constants."""

SURE = 10
"""Results at the head of a ranking whose templates run as `Engine.run` has them."""

MOST_CELLS = 1 << 20
"""Cells of all pictures between two templates that are looked at in one search."""

NEAREST = 12
"""Pictures between two templates on which a second template runs whose cells are coupled, which
takes a hundred times as long."""


@dataclass(frozen=True, slots=True)
class Hit:
    """A template that fits words.

    Attributes
    ----------
    name, summary : str
    score : float
        The larger, the better it fits; the best of a search has 1.
    """

    name: str
    summary: str
    score: float


@dataclass(frozen=True, slots=True)
class Match:
    """Result of a template, or of a program of two templates, on an example.

    Attributes
    ----------
    name : str
        Name of the template, or "EROSION → EDGE" for a program.
    wrong : int
        Number of cells with a wrong sign.
    cells : int
        Number of cells with a desired sign.
    margin : float
        Largest change of the bias without a wrong cell, as measured on the template's own check;
        NaN if it is not known. For a program, the smaller of the two.
    templates : tuple of str
        Names of the templates in the order in which they run.
    """

    name: str
    wrong: int
    cells: int
    margin: float
    templates: tuple[str, ...]


def find_by_words(words: str, most: int = 10, *, tags: Sequence[str] = ()) -> list[Hit]:
    """Return the templates of the library that words describe, the best first.

    Parameters
    ----------
    words : str
        As in "fill holes", "skeletonization" or "sobel". Without words, every template fits that
        has the tags.
    most : int
        Templates at most.
    tags : sequence of str
        Only templates with all of these tags are returned.

    Raises
    ------
    UnknownNameError
        If no template has such a tag.
    """
    tagged = _tagged(tags)
    wanted = _weights(words)
    if not wanted:
        names = sorted(tagged) if tags and not words.strip() else []
        return [Hit(name, _summary(name), 1.0) for name in names[:most]]
    documents = dict(_documents())
    seen = Counter(stem for weights in documents.values() for stem in weights)
    for stem in {stem for ways in wanted for stem, share in ways.items() if share == 1.0}:
        within = [name for name in documents if len(stem) > 2 and stem in name.lower()]
        for name in within:
            documents[name] = {**documents[name], stem: max(NAME, documents[name].get(stem, 0.0))}
        seen[stem] = max(seen[stem], len(within))
    rare = {stem: math.log(1.0 + len(documents) / max(1, n)) for stem, n in seen.items()}
    scores: dict[str, float] = {}
    for name, weights in documents.items():
        # each word asked for counts once, by its best way into the description
        scores[name] = sum(
            max(
                (
                    share * weights[stem] * rare[stem]
                    for stem, share in ways.items()
                    if stem in weights
                ),
                default=0.0,
            )
            for ways in wanted
        )
    scores = {name: score for name, score in scores.items() if score > 0.0 and name in tagged}
    best = max(scores.values(), default=0.0)
    names = sorted(scores, key=lambda n: (-scores[n], n))
    return [Hit(name, _summary(name), scores[name] / best) for name in names[:most]]


def tags_of_library() -> tuple[str, ...]:
    """Return every tag that a template of the library has."""
    return tuple(sorted({tag for name in template_names() for tag in get_entry(name).about.tags}))


def _tagged(tags: Sequence[str]) -> set[str]:
    """Return the templates that have all of some tags."""
    known = tags_of_library()
    for tag in tags:
        if tag not in known:
            raise name_error("tag", tag, known)
    return {n for n in template_names() if set(tags) <= set(get_entry(n).about.tags)}


def find_by_example(
    given: ArrayLike,
    wanted: ArrayLike,
    *,
    state: ArrayLike | None = None,
    engine: Engine | None = None,
    names: Iterable[str] | None = None,
    most: int = SURE,
    watch: Callable[[str], bool] = bool,
    outputs: dict[str, Floats] | None = None,
) -> list[Match]:
    """Return the results of all templates on an example, in order of wrong cells.

    All of them run in fixed steps, as long as signs change. The best ones then run once more as
    `Engine.run` has it, which for many takes a hundred times as long.

    Parameters
    ----------
    given : (rows, cols) or (pictures, rows, cols) float
        Input: black is +1, white −1.
    wanted : like `given`
        The sign that the output of each cell should have; NaN where it does not matter.
    state : like `given`, optional
        Initial state. The default is that of each template, or the input if it starts from one.
    engine : Engine, optional
        The default is "numba", which compiles nothing for a template.
    names : iterable of str, optional
        Templates to try. The default is the whole library.
    most : int
        Number of results that are wanted, whose templates run once more.
    watch : callable
        Called with the name of each template before it runs; if it returns False, the search ends
        with what it has.
    outputs : dict, optional
        Filled with the output of each template, for `find_programs`.

    Returns
    -------
    list of Match
        Templates with several layers or inputs, those that cannot run on these pictures, and those
        that need a state if none is given are left out.

    Raises
    ------
    ArrayError
        If the pictures do not fit together, or no cell has a desired sign.
    """
    inputs, signs, matter = _example(given, wanted)
    used, result = engine or Engine("numba"), list[Match]()
    start = None if state is None else np.asarray(state)

    def match(name: str, output: Floats | None) -> Match | None:
        if output is None:
            return None
        wrong = int(((output > 0.0) != (signs > 0.0))[matter].sum())
        return Match(name, wrong, int(matter.sum()), _margin(name), (name,))

    for name in names if names is not None else template_names():
        template = get_entry(name).template
        if not _takes_one_picture(template) or (template.needs_state and state is None):
            continue
        if not watch(name):
            return sorted(result, key=_rank)
        output = _quickly(used, template, inputs, start)
        found = match(name, output)
        result += [] if found is None else [found]
        if outputs is not None and output is not None:
            outputs[template.name] = output

    def again(found: Match) -> Match | None:
        (name,) = found.templates
        return match(name, _output(used, get_entry(name).template, inputs, start))

    return _made_sure(result, most, again, watch)


def _made_sure(
    matches: Iterable[Match],
    most: int,
    again: Callable[[Match], Match | None],
    watch: Callable[[str], bool],
) -> list[Match]:
    """Return matches in their order, where the best ones have been looked at once more."""
    waiting, sure = sorted(matches, key=_rank), list[Match]()
    while waiting and (len(sure) < most or _rank(waiting[0]) < _rank(sure[most - 1])):
        if not watch(waiting[0].name):
            break
        found = again(waiting.pop(0))
        if found is not None:
            sure = sorted([*sure, found], key=_rank)
    return sorted([*sure, *waiting], key=_rank)


def find_programs(
    given: ArrayLike,
    wanted: ArrayLike,
    *,
    engine: Engine | None = None,
    names: Iterable[str] | None = None,
    most: int = SURE,
    watch: Callable[[str], bool] = bool,
    outputs: dict[str, Floats] | None = None,
) -> list[Match]:
    """Return the programs of two templates with the fewest wrong cells on an example.

    The second template runs on the output of the first. One that needs two pictures gets the
    given picture as the other, either as its input or as its initial state.

    Parameters
    ----------
    given, wanted, engine, names, watch
        As in `find_by_example`; `watch` is called for each template in both positions.
    outputs : dict, optional
        Outputs of templates on the example, which `find_by_example` knows.
    most : int
        Largest number of programs to return.

    Notes
    -----
    Among templates with the same output on the given picture, only one is tried as the first, and
    likewise among outputs that equal the given picture or have only one colour. If these outputs
    have more than 2²⁰ cells in total, those nearest to the desired picture are kept, and a second
    template with coupled cells runs only on the nearest 12.

    Raises
    ------
    ArrayError
        As `find_by_example`.
    """
    inputs, signs, matter = _example(given, wanted)
    used = engine or Engine("numba")
    taken = template_names() if names is None else names
    taken = [name for name in taken if _takes_one_picture(get_entry(name).template)]
    first_run = partial(_known, outputs or {}, used)
    firsts, between = _between(first_run, taken, inputs, signs, matter, watch)
    result = list[Match]()

    def matches(run: _Run, name: str, before: Sequence[str], pictures: Floats) -> list[Match]:
        return [
            Match(f"{first} → {name}{said}", int(count), int(matter.sum()),
                  min(_margin(first), _margin(name)), (first, name))
            for said, output in _seconds(run, name, pictures, inputs)
            for first, count in zip(
                before, ((output > 0.0) != (signs > 0.0))[:, matter].sum(axis=1), strict=True
            )
        ]  # fmt: skip

    for name in taken if firsts else ():
        if not watch(name):
            return result[:most]
        few = len(firsts) if _alone(get_entry(name).template) else NEAREST
        run = partial(_quickly, used)
        result = sorted([*result, *matches(run, name, firsts[:few], between[:few])], key=_rank)
        del result[4 * most :]  # more than are wanted, as some may fall behind in the next runs

    def again(found: Match) -> Match | None:
        first, name = found.templates
        output = _output(used, get_entry(first).template, inputs, None)
        if output is None:
            return None
        pictures = np.clip(output, -1.0, 1.0)[np.newaxis]
        sure = matches(partial(_output, used), name, [first], pictures)
        return next((match for match in sure if match.name == found.name), None)

    return _made_sure(result, most, again, watch)[:most]


_Run = Callable[[Template, Floats, Floats | None], Floats | None]
"""Runs a template on inputs from a state, or from its own; None where it cannot run on them."""


def _known(
    outputs: Mapping[str, Floats], engine: Engine, template: Template, inputs: Floats
) -> Floats | None:
    """Return a template's output on the example, which may be known."""
    if template.name in outputs:
        return outputs[template.name]
    return _quickly(engine, template, inputs, None)


def _between(
    run: Callable[[Template, Floats], Floats | None],
    names: Sequence[str],
    inputs: Floats,
    signs: Floats,
    matter: NDArray[np.bool_],
    watch: Callable[[str], bool],
) -> tuple[list[str], Floats]:
    """Return first templates whose outputs differ, and these outputs, the nearest ones first."""
    known = {np.round(inputs, 3).tobytes()}
    outputs = list[tuple[int, str, Floats]]()
    for name in sorted(names, key=lambda n: (-np.nan_to_num(_margin(n)), n)):
        template = get_entry(name).template
        if template.needs_state:
            continue
        if not watch(name):
            break
        output = run(template, inputs)
        if output is None or np.ptp(output) < HALF:
            continue
        output = np.clip(output, -1.0, 1.0)
        key = np.round(output, 3).tobytes()
        if key not in known:
            known.add(key)
            wrong = int(((output > 0.0) != (signs > 0.0))[matter].sum())
            outputs.append((wrong, name, output))
    outputs.sort(key=lambda entry: entry[:2])
    kept = outputs[: max(1, MOST_CELLS // inputs.size)]
    return [name for _, name, _ in kept], np.array([output for _, _, output in kept])


HALF = 0.5
"""Range of an output below which it counts as having one colour."""


def _seconds(run: _Run, name: str, between: Floats, inputs: Floats) -> Iterator[tuple[str, Floats]]:
    """Yield how a second template gets its pictures, and its outputs."""
    template = get_entry(name).template
    if not template.needs_state:
        output = run(template, between, None)
        if output is not None:
            yield "", output
        return
    whole = np.broadcast_to(inputs, between.shape)
    for said, pair in (
        (" (state: the given picture)", (between, whole)),
        (" (input: the given picture)", (whole, between)),
    ):
        output = run(template, *pair)
        if output is not None:
            yield said, output


def _takes_one_picture(template: Template) -> bool:
    return template.layers == 1 and template.inputs <= 1


def _output(
    engine: Engine, template: Template, inputs: Floats, state: Floats | None
) -> Floats | None:
    """Return a template's output; None where it cannot run on such pictures."""
    if state is None and template.initial == "input":
        state = inputs
    try:
        result = engine.run(template, input=inputs if template.inputs else None, state=state)
    except CnnumError:
        return None
    return np.asarray(result.output, np.float64)


def _quickly(
    engine: Engine, template: Template, inputs: Floats, state: Floats | None
) -> Floats | None:
    """Return what `_output` does as fixed steps have it, without the proofs of a rest."""
    if state is None and template.initial == "input":
        state = inputs
    given: dict[str, Any] = {"input": inputs if template.inputs else None, "state": state}
    slowest, quickest = float(template.tau.max()), float(template.tau.min())
    timed = None if template.duration == "settle" else float(template.duration)
    end = FIRST_LOOK * slowest if timed is None else timed
    try:
        if _alone(template):
            return np.asarray(engine.run(template, **given, method="decision").output, np.float64)
    except CnnumError:
        pass  # some cells are too close to call
    try:
        step = min(0.5 * stability_bound(template, inputs.shape[-2:], "rk4").step, STEP * quickest)
        steps: dict[str, Any] = {"method": "rk4", "dt": end / math.ceil(end / step)}
        run = engine.run(template, **given, duration=end, **steps)
    except (CnnumError, ArithmeticError):  # there are delays, or the duration is 0
        try:
            run = engine.run(template, **given, duration=end)
        except CnnumError:
            return None
        return np.asarray(run.output, np.float64)
    result, x, passed = np.array(run.output, np.float64), np.array(run.state), end
    moving = np.ones(result.shape[:-2], bool)
    while timed is None and moving.any() and passed < LAST_LOOK * slowest:
        some: dict[str, Any] = {
            role: maps if maps is None else np.broadcast_to(maps, x.shape)[moving]
            for role, maps in given.items()
        }
        some["state"] = x[moving]
        run = engine.run(template, **some, duration=passed, **steps)
        still = ((run.output > 0.0) == (result[moving] > 0.0)).all(axis=(-2, -1))
        x[moving], result[moving] = run.state, run.output
        moving[moving], passed = ~still, 2.0 * passed
    return result


def _margin(name: str) -> float:
    measured = get_entry(name).measured
    return math.nan if measured is None or measured.margin is None else measured.margin


def _rank(match: Match) -> tuple[int, float, str]:
    return match.wrong, -float(np.nan_to_num(match.margin)), match.name


def _example(given: ArrayLike, wanted: ArrayLike) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return the input, the signs that are wanted, and the cells where they matter."""
    inputs, signs = np.asarray(given, np.float64), np.asarray(wanted, np.float64)
    if inputs.shape != signs.shape or inputs.ndim not in (2, 3):
        raise ArrayError(
            "An example must be an input and an output of the same shape, (rows, cols) or "
            f"(pictures, rows, cols), got {inputs.shape} and {signs.shape}."
        )
    matter = np.isfinite(signs) & (signs != 0.0)
    if not matter.any():
        raise ArrayError(
            "The desired output has no cell above or below 0, so it specifies nothing."
        )
    return inputs, signs, matter


@dataclass(frozen=True, slots=True)
class Figures:
    """Properties of a template that are known without a run.

    Attributes
    ----------
    stability, why : str
        Stability class, and the reason as a sentence.
    products, tables, once : int
        Multiplications and table look-ups per cell and step, and multiplications with the input,
        which happen once.
    settle : float or None
        Settling time on the largest array that was measured, in the unit of τ.
    margin : float or None
        Largest change of the bias without a wrong cell in the check.
    """

    stability: str
    why: str
    products: int
    tables: int
    once: int
    settle: float | None
    margin: float | None


def figures(template: Template) -> Figures:
    """Return stability class, cost and measured properties of a template in the library."""
    kind, late = stability_class(template), template.delayed
    linear = [template.A, *([late.A, late.B] if late else [])]
    dynamic = [c for c in template.nonlinear if not c.static]
    measured = None
    if template.name in template_names():
        entry = get_entry(template.name)
        measured = entry.measured if entry.template.digest == template.digest else None
    return Figures(
        kind.name,
        kind.why,
        sum(int((part != 0.0).sum()) for part in linear),
        sum(int((c.weights != 0.0).sum()) for c in dynamic),
        int((template.B != 0.0).sum()),
        measured.settle[-1][1] if measured and measured.settle else None,
        measured.margin if measured else None,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Two templates side by side.

    Attributes
    ----------
    names : (str, str)
    differs : dict of str to (object, object)
        Properties that differ, by name.
    figures : (Figures, Figures)
        Stability class, cost and measured properties.
    exhaustive : bool
        Whether the templates were compared on all 512 neighbourhoods instead of random pictures. If
        one of the templates needs a state, each neighbourhood is used with a white and a black one.
    cases, unlike : int
        Number of neighbourhoods, or cells of the pictures, that were compared, and of those with
        different outputs. Both are 0 for templates with several layers or inputs, whose outputs are
        not compared.
    inputs : (unlike pictures, rows, cols) float
        Neighbourhoods, or pictures, with different outputs.
    states : like `inputs` or None
        Initial states, if one of the templates needs them.
    answers : (2, pictures) or (2, pictures, rows, cols) float
        Outputs of the first and of the second template.
    """

    names: tuple[str, str]
    differs: dict[str, tuple[object, object]]
    figures: tuple[Figures, Figures]
    exhaustive: bool
    cases: int
    unlike: int
    inputs: Floats = field(repr=False)
    states: Floats | None = field(repr=False)
    answers: Floats = field(repr=False)


def compare(first: Template, second: Template, *, engine: Engine | None = None) -> Comparison:
    """Return in which properties two templates differ, and on which inputs they answer otherwise.

    Two uncoupled templates that read a cell's eight neighbours are compared on all 512
    neighbourhoods. Others run on random pictures, half black and half white, whose seed is fixed.
    """
    pair = first, second
    about = (
        (first.name, second.name),
        _differences(first, second),
        (figures(first), figures(second)),
    )
    if not all(map(_takes_one_picture, pair)):
        none = np.zeros((0, 3, 3))
        return Comparison(*about, False, 0, 0, none, None, np.zeros((2, 0)))
    used = engine or Engine("numba")
    two = any(template.needs_state for template in pair)
    whole = all(_alone(template) and template.radius <= 1 for template in pair)
    random = np.random.default_rng(0)
    if whole:
        bits = np.arange(1024 if two else 512)[:, None] >> np.arange(10) & 1
        colours = np.where(bits == 1, 1.0, -1.0)
        pictures = colours[:, :9].reshape(-1, 3, 3)
        states = np.broadcast_to(colours[:, 9:, None], pictures.shape)
    else:
        pictures, states = np.where(random.random((2, PICTURES, SIDE, SIDE)) < 0.5, 1.0, -1.0)
    answers = np.stack([_answers(used, template, pictures, states) for template in pair])
    if whole:
        answers = answers[:, :, 1, 1]
    unlike = (answers[0] > 0.0) != (answers[1] > 0.0)
    shown = unlike if whole else unlike.any(axis=(1, 2))
    return Comparison(
        *about,
        whole,
        int(unlike.size),
        int(unlike.sum()),
        pictures[shown],
        states[shown] if two else None,
        answers[:, shown],
    )


def _alone(template: Template) -> bool:
    """Return whether a cell's state depends on no other cell's."""
    feedback = template.A.copy()
    feedback[..., feedback.shape[-2] // 2, feedback.shape[-1] // 2] = 0.0
    return not feedback.any() and template.plain


def _answers(engine: Engine, template: Template, pictures: Floats, states: Floats) -> Floats:
    start = states if template.needs_state else pictures if template.initial == "input" else None
    given = pictures if template.inputs else None
    if given is None and start is None:
        start = np.full(pictures.shape, template.initial)
    return np.asarray(engine.run(template, input=given, state=start).output, np.float64)


_PROPERTIES = ("A", "B", "z", "tau", "boundary", "input_boundary", "initial", "duration", "output")


def _differences(first: Template, second: Template) -> dict[str, tuple[object, object]]:
    result: dict[str, tuple[object, object]] = {}
    for name in (*_PROPERTIES, "radius", "nonlinear", "delayed", "gains"):
        this, other = getattr(first, name), getattr(second, name)
        arrays = isinstance(this, np.ndarray) or isinstance(other, np.ndarray)
        if not (np.array_equal(cast(Any, this), cast(Any, other)) if arrays else this == other):
            result[name] = (this, other)
    return result


@cache
def _documents() -> dict[str, dict[str, float]]:
    """Return for each template the largest weight of every stem in its description."""
    result = dict[str, dict[str, float]]()
    for name in template_names():
        entry = get_entry(name)
        summary, weights = _summary(name), dict[str, float]()
        parts = (
            (NAME, [name, *entry.aliases]),
            (TAG, entry.about.tags),
            (FIRST, [summary]),
            (TEXT, [entry.template.description]),
        )
        for weight, texts in parts:
            for stem in _stems(" ".join(texts)):
                weights[stem] = max(weight, weights.get(stem, 0.0))
        weights[_stem(name.lower())] = WHOLE
        result[name] = weights
    return result


def _summary(name: str) -> str:
    head, stop, _ = " ".join(get_entry(name).template.description.split()).partition(". ")
    return head + "." if stop else head


def _weights(words: str) -> list[dict[str, float]]:
    """Return for each word its stem with 1, and the stems of related words with less."""
    result = list[dict[str, float]]()
    for stem in dict.fromkeys(_stems(words)):
        ways = {stem: 1.0}
        for group in RELATED:
            stems = {root for word in group for root in _stems(word)}
            if stem in stems:
                ways = {**dict.fromkeys(stems, KIN), **ways}
        result.append(ways)
    return result


_ENDINGS = (
    *(
        "izations",
        "isations",
        "ization",
        "isation",
        "ations",
        "ation",
        "ings",
        "ing",
        "ions",
        "ion",
    ),
    *("izes", "ises", "ized", "ised", "ical", "ic", "ers", "er", "ed", "es", "s", "e"),
)


def _stems(text: str) -> Sequence[str]:
    """Return the words of a text without their usual endings."""
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", text)
    words = [word for word in re.findall(r"[a-z]+", spaced.lower()) if word not in LEFT_OUT]
    return [_stem(word) for word in words if len(word) > 1]


def _stem(word: str) -> str:
    for ending in _ENDINGS:
        if word.endswith(ending) and len(word) - len(ending) >= 3:
            return word[: -len(ending)]
    return word
