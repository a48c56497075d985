"""The content of a template file: the template, its measured figures and its proof.

Figures of a template that a command measured, as the table [measured] of its file keeps them.

`cnnum templates measure` writes the table as the last one of the file; nothing else should.

Proofs and measurements of a designed template, as the table [proof] of its file.

`cnnum templates design` writes it. A change of the weights by hand makes it void, as its digest
differs.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import cast

from cnnum.errors import TemplateError
from cnnum.safety.values import checked_name
from cnnum.templating.files.toml_values import number, points, table, text, whole, wrong
from cnnum.templating.template import Template

MEASURED_KEYS = ("digest", "mean", "rms", "settle", "margin")


@dataclass(frozen=True, slots=True)
class Measured:
    """Figures of a template on the pictures of its own check.

    Attributes
    ----------
    digest : str
        Digest of all numbers that change a run, so that none changes unseen.
    mean, rms : float
        Mean and RMS of the final states of the check's run on 8×8 cells.
    settle : tuple of (cells along a side, time constants)
        When the outputs come within 0.01 of their end, on square arrays. It is empty if they
        never do within the longest run, or where the check stops before.
    margin : float or None
        The largest number that may be added to the bias, and taken from it, with no wrong cell.
        None if the answer is gray.
    """

    digest: str
    mean: float
    rms: float
    settle: tuple[tuple[int, float], ...] = ()
    margin: float | None = None


def read_measured(file: str, key: str, value: object) -> Measured:
    """Return the values of the table [measured].

    Raises
    ------
    TemplateError
        If a key is missing or unknown, or a value is wrong.
    """
    result = table(file, key, value)
    unknown = [name for name in result if name not in MEASURED_KEYS]
    missing = [name for name in MEASURED_KEYS[:3] if name not in result]
    if unknown or missing:
        raise TemplateError(
            f"'{file}': the table '{key}' must have the keys {', '.join(MEASURED_KEYS)}, got "
            f"{', '.join(result) or 'none'}; measure the template again."
        )
    margin = result.get("margin")
    return Measured(
        text(file, f"{key}.digest", result["digest"]),
        number(file, f"{key}.mean", result["mean"]),
        number(file, f"{key}.rms", result["rms"]),
        _settle(file, f"{key}.settle", result.get("settle", [])),
        None if margin is None else number(file, f"{key}.margin", margin),
    )


def _settle(file: str, key: str, value: object) -> tuple[tuple[int, float], ...]:
    return tuple((int(cells), time) for cells, time in points(file, key, value))


def measured_toml(measured: Measured) -> str:
    """Return the table [measured] as TOML, without an empty line before it."""
    pairs = ", ".join(f"[{cells}, {time:.3g}]" for cells, time in measured.settle)
    lines = {
        "digest": f'"{measured.digest}"',
        "mean": f"{measured.mean:.6g}",
        "rms": f"{measured.rms:.6g}",
    }
    if measured.settle:
        lines["settle"] = f"[{pairs}]"
    if measured.margin is not None:
        lines["margin"] = f"{measured.margin:.3g}"
    return "[measured]\n" + "".join(f"{key} = {value}\n" for key, value in lines.items())


REQUIRED = ("digest", "method", "examples", "margin", "relative_margin")
PROOF_KEYS = (
    *REQUIRED, "bound", "settle", "worst_case", "worst_case_weights", "area", "flips",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class FlipRate:
    """How often a cell of the check was wrong under mismatch.

    Attributes
    ----------
    mismatch : float
        Mismatch of every weight, as a share of itself: the standard deviation.
    rate : float
        Share of the drawn templates with a wrong cell.
    low, high : float
        Confidence interval of the rate (95 %, Wilson).
    draws : int
    """

    mismatch: float
    rate: float
    low: float
    high: float
    draws: int


@dataclass(frozen=True, slots=True)
class Proof:
    """The proof of a designed template.

    Attributes
    ----------
    digest : str
        Digest of the numbers that the proof is of.
    method : str
        "linear program", "search" or "gradients".
    examples : int
        Neighbourhoods that the weights were held to; of a search, templates that were run; of
        gradients, labelled cells.
    margin : float
        Least drive of a cell, towards its right colour; below 0 where an example is decided wrong.
    relative_margin : float
        The same over the sum of all weights that decide, each times the size of its input. It
        compares weights of one form; `worst_case` says how far they may be off.
    bound : float or None
        No weights have a larger relative margin, or None if that is not known.
    settle : float or None
        Time constants until every cell of exact weights is black or white. None if cells wait
        for each other, or never are.
    worst_case : float or None
        With every weight off by less than this share of itself, separately, every cell of every
        neighbourhood is within half a colour of the right one at the end of the template's run.
        None if no such bound is known.
    worst_case_weights : str
        The mismatch that makes a cell wrong beyond it, as in "A[1, 1] larger, z smaller in size".
    flips : tuple of FlipRate
    area : float or None
        For a learned decision, the area under the ROC curve on examples outside the training set.
    """

    digest: str
    method: str
    examples: int
    margin: float
    relative_margin: float
    bound: float | None = None
    settle: float | None = None
    worst_case: float | None = None
    worst_case_weights: str = ""
    flips: tuple[FlipRate, ...] = ()
    area: float | None = None


def read_proof(file: str, key: str, value: object) -> Proof:
    """Return the proof that the table [proof] states; it raises as `read_measured`."""
    result = table(file, key, value)
    if set(result) - set(PROOF_KEYS) or set(REQUIRED) - set(result):
        raise TemplateError(
            f"'{file}': the table '{key}' must have the keys {', '.join(PROOF_KEYS)}, got "
            f"{', '.join(result) or 'none'}; design the template again."
        )

    def optional(name: str) -> float | None:
        return number(file, f"{key}.{name}", result[name]) if name in result else None

    return Proof(
        text(file, f"{key}.digest", result["digest"]),
        text(file, f"{key}.method", result["method"]),
        whole(file, f"{key}.examples", result["examples"]),
        number(file, f"{key}.margin", result["margin"]),
        number(file, f"{key}.relative_margin", result["relative_margin"]),
        optional("bound"),
        optional("settle"),
        optional("worst_case"),
        text(file, f"{key}.worst_case_weights", result.get("worst_case_weights", "")),
        tuple(_flip(file, f"{key}.flips", row) for row in _rows(result.get("flips", []))),
        optional("area"),
    )


def proof_toml(proof: Proof) -> list[str]:
    """Return the lines of the table [proof]."""
    lines = [
        "[proof]",
        f'digest = "{proof.digest}"',
        f'method = "{proof.method}"',
        f"examples = {proof.examples}",
        f"margin = {proof.margin:.9g}",
        f"relative_margin = {proof.relative_margin:.9g}",
    ]
    optional = {"bound": proof.bound, "settle": proof.settle, "area": proof.area}
    lines += [f"{key} = {value:.9g}" for key, value in optional.items() if value is not None]
    if proof.worst_case is not None:
        lines.append(f"worst_case = {math.floor(proof.worst_case * 1e9) / 1e9:.9g}")
        lines.append(f'worst_case_weights = "{proof.worst_case_weights}"')
    if proof.flips:
        rows = (
            f"[{f.mismatch:g}, {f.rate:.6g}, {f.low:.6g}, {f.high:.6g}, {f.draws}]"
            for f in proof.flips
        )
        lines.append(f"flips = [{', '.join(rows)}]")
    return lines


def _rows(value: object) -> list[object]:
    return cast("list[object]", value) if isinstance(value, list) else [value]


def _flip(file: str, key: str, value: object) -> FlipRate:
    if len(row := _rows(value)) != 5:
        raise wrong(file, key, "rows [mismatch, rate, low, high, draws]", row)
    mismatch, rate, low, high = (number(file, key, item) for item in row[:4])
    return FlipRate(mismatch, rate, low, high, whole(file, key, row[4]))


@dataclass(frozen=True, slots=True)
class About:
    """The words that a file has about its template; they change no run.

    Attributes
    ----------
    input, state : str
        The meaning of the input and of the initial state.
    tags : tuple of str
    experimental : str
        Why no check shows that the template does its job; empty if one does.
    published_boundary : str
        The boundary that the source names, where the library uses another.
    """

    input: str = ""
    state: str = ""
    tags: tuple[str, ...] = ()
    experimental: str = ""
    published_boundary: str = ""


@dataclass(frozen=True, slots=True)
class Guess:
    """What a reader took a file of another program to mean, where the file does not say it.

    Attributes
    ----------
    key : str
        The key of the TOML format that it bears on.
    sentence : str
    always : bool
        Whether the format has no words for it, so that every file of it leaves it open.
    """

    key: str
    sentence: str
    always: bool = False


@dataclass(frozen=True, slots=True)
class Entry:
    """A template, the other names it goes by, the words about it, its measured figures and proof.

    Attributes
    ----------
    measured : Measured or None
        Written by a command, or None if nothing was measured yet.
    proof : Proof or None
        Proof of a template that a command designed.
    guesses : tuple of Guess
        What the reader of a file guessed; none for TOML.

    Raises
    ------
    TemplateError
        If an alias is not one line of plain signs.
    """

    template: Template
    aliases: tuple[str, ...] = ()
    about: About = field(default_factory=About)
    measured: Measured | None = None
    proof: Proof | None = None
    guesses: tuple[Guess, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        for alias in self.aliases:
            checked_name("an alias of a template", alias, TemplateError)


@dataclass(frozen=True, slots=True)
class FileFormat:
    """A file format of templates.

    Attributes
    ----------
    suffix : str
        In lower case, with its dot.
    read : callable
        (text, name of the file) to an entry; the name is for error messages only.
    write : callable
        An entry to text.
    """

    suffix: str
    read: Callable[[str, str], Entry]
    write: Callable[[Entry], str]
