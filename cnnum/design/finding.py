"""Templates found in the library: by words, by an example of what one should do, and compared."""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.errors import ArrayError, CnnumError
from cnnum.templating.library import get_entry, template_names
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
    """A template's answer to an example.

    Attributes
    ----------
    name : str
    wrong : int
        Cells whose sign is not the wanted one.
    cells : int
        Cells with a wanted sign.
    margin : float
        By how much its bias may be off with no wrong cell, as measured; NaN where it is not known.
    """

    name: str
    wrong: int
    cells: int
    margin: float


def find_by_words(words: str, most: int = 10) -> list[Hit]:
    """Return the templates of the library that words describe, the best first.

    Parameters
    ----------
    words : str
        As in "fill holes", "skeletonization" or "sobel".
    most : int
        Templates at most.
    """
    asked = _weights(words)
    if not asked:
        return []
    documents = dict(_documents())
    seen = Counter(stem for weights in documents.values() for stem in weights)
    for stem in {stem for ways in asked for stem, share in ways.items() if share == 1.0}:
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
            for ways in asked
        )
    best = max(scores.values(), default=0.0)
    names = sorted((name for name in scores if scores[name] > 0.0), key=lambda n: (-scores[n], n))
    return [Hit(name, _summary(name), scores[name] / best) for name in names[:most]]


def find_by_example(
    given: ArrayLike,
    wanted: ArrayLike,
    *,
    state: ArrayLike | None = None,
    engine: Engine | None = None,
    names: Iterable[str] | None = None,
    say: Callable[[str], object] = str,
) -> list[Match]:
    """Return every template's answer to an example, the one with the fewest wrong cells first.

    Parameters
    ----------
    given : (rows, cols) or (pictures, rows, cols) float
        Input: black is +1, white −1.
    wanted : like `given`
        The sign that the output of each cell should have; NaN where it does not matter.
    state : like `given`, optional
        Initial state; a template's own unless given, and the input where it starts from one.
    engine : Engine, optional
        Numba unless given, which compiles nothing for a template.
    names : iterable of str, optional
        Templates to try; all of the library unless given.
    say : callable
        Called with the name of each template before it runs.

    Returns
    -------
    list of Match
        Templates of several layers or inputs, and those that cannot run on these pictures, are
        left out.

    Raises
    ------
    ArrayError
        If the pictures do not fit together, or no cell has a wanted sign.
    """
    inputs, signs = np.asarray(given, np.float64), np.asarray(wanted, np.float64)
    if inputs.shape != signs.shape or inputs.ndim not in (2, 3):
        raise ArrayError(
            "An example must be an input and an output of the same shape, (rows, cols) or "
            f"(pictures, rows, cols), got {inputs.shape} and {signs.shape}."
        )
    matter = np.isfinite(signs) & (signs != 0.0)
    if not matter.any():
        raise ArrayError("The desired output has no cell above or below 0, so it asks for nothing.")
    used, result = engine or Engine("numba"), list[Match]()
    for name in names if names is not None else template_names():
        entry = get_entry(name)
        template = entry.template
        if template.layers != 1 or template.inputs > 1:
            continue
        say(name)
        try:
            starts = (
                state if state is not None else (inputs if template.initial == "input" else None)
            )
            output = np.asarray(used.run(template, input=inputs, state=starts).output)
        except CnnumError:
            continue
        wrong = int(((output > 0.0) != (signs > 0.0))[matter].sum())
        margin = None if entry.measured is None else entry.measured.margin
        result.append(Match(name, wrong, int(matter.sum()), math.nan if margin is None else margin))
    return sorted(result, key=lambda m: (m.wrong, -np.nan_to_num(m.margin), m.name))


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Two templates side by side.

    Attributes
    ----------
    differs : dict of str to (object, object)
        Properties that differ, by name.
    exhaustive : bool
        Whether all 512 neighbourhoods were decided by both, and not random pictures.
    cases, unlike : int
        Neighbourhoods, or cells of the pictures, that were decided; and those decided differently.
    inputs : (unlike pictures, rows, cols) float
        Neighbourhoods, or pictures, with another answer.
    answers : (2, pictures) or (2, pictures, rows, cols) float
        Of the first template and of the second.
    """

    differs: dict[str, tuple[object, object]]
    exhaustive: bool
    cases: int
    unlike: int
    inputs: Floats = field(repr=False)
    answers: Floats = field(repr=False)


def compare(first: Template, second: Template, *, engine: Engine | None = None) -> Comparison:
    """Return in which properties two templates differ, and on which inputs they answer otherwise.

    Two uncoupled templates that read a cell's eight neighbours are compared on all 512
    neighbourhoods. Others run on random pictures, half black and half white, whose seed is fixed.

    Raises
    ------
    ArrayError
        If one of them has several layers or inputs.
    """
    for template in (first, second):
        if template.layers != 1 or template.inputs > 1:
            raise ArrayError(
                f"Template '{template.name}' has {template.layers} layers and "
                f"{template.inputs} inputs: only answers of templates with one of each can be "
                "compared."
            )
    used = engine or Engine("numba")
    whole = all(_alone(template) and template.radius <= 1 for template in (first, second))
    if whole:
        bits = np.arange(512)[:, None] >> np.arange(9) & 1
        pictures = np.where(bits.reshape(512, 3, 3) == 1, 1.0, -1.0)
    else:
        random = np.random.default_rng(0)
        pictures = np.where(random.random((PICTURES, SIDE, SIDE)) < 0.5, 1.0, -1.0)
    answers = np.stack([_answers(used, template, pictures) for template in (first, second)])
    if whole:
        answers = answers[:, :, 1, 1]
    unlike = (answers[0] > 0.0) != (answers[1] > 0.0)
    shown = unlike if whole else unlike.any(axis=(1, 2))
    return Comparison(
        _differences(first, second),
        whole,
        int(unlike.size),
        int(unlike.sum()),
        pictures[shown],
        answers[:, shown],
    )


def _alone(template: Template) -> bool:
    """Return whether a cell's state depends on no other cell's."""
    feedback = template.A.copy()
    feedback[..., feedback.shape[-2] // 2, feedback.shape[-1] // 2] = 0.0
    return not feedback.any() and template.plain


def _answers(engine: Engine, template: Template, pictures: Floats) -> Floats:
    starts = pictures if template.initial == "input" else None
    return np.asarray(engine.run(template, input=pictures, state=starts).output, np.float64)


_PROPERTIES = ("A", "B", "z", "tau", "boundary", "input_boundary", "initial", "duration", "output")


def _differences(first: Template, second: Template) -> dict[str, tuple[object, object]]:
    result: dict[str, tuple[object, object]] = {}
    for name in (*_PROPERTIES, "radius", "nonlinear", "delayed", "gains"):
        one, other = getattr(first, name), getattr(second, name)
        arrays = isinstance(one, np.ndarray) or isinstance(other, np.ndarray)
        if not (np.array_equal(cast(Any, one), cast(Any, other)) if arrays else one == other):
            result[name] = (one, other)
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
            stems = {one for word in group for one in _stems(word)}
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
