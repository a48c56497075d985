"""Proofs and measurements of a designed template, as the table [proof] of its file.

`cnnum templates design` writes it. A change of the weights by hand makes it void, as its digest
differs.
"""

import math
from dataclasses import dataclass
from typing import cast

from cnnum.errors import TemplateError
from cnnum.templating.files.toml_values import number, table, text, whole, wrong

REQUIRED = ("digest", "method", "examples", "margin", "relative_margin")
KEYS = (
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
        Of the rate, with 95 % confidence (Wilson).
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
        No weights have a larger relative margin; None where that is not known.
    settle : float or None
        Time constants until every cell of exact weights is black or white. None where cells wait
        for each other, or never are.
    worst_case : float or None
        With every weight off by less than this share of itself, each by itself, every cell of every
        neighbourhood is within half a colour of the right one at the end of the template's run.
        None where no such bound is known.
    worst_case_weights : str
        The mismatch that makes a cell wrong beyond it, as in "A[1, 1] larger, z smaller in size".
    flips : tuple of FlipRate
    area : float or None
        Of a learned decision: the area under the curve on examples that it did not learn from.
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
    found = table(file, key, value)
    if set(found) - set(KEYS) or set(REQUIRED) - set(found):
        raise TemplateError(
            f"'{file}': the table '{key}' has the keys {', '.join(KEYS)}, got "
            f"{', '.join(found) or 'none'}; design the template again."
        )

    def optional(name: str) -> float | None:
        return number(file, f"{key}.{name}", found[name]) if name in found else None

    return Proof(
        text(file, f"{key}.digest", found["digest"]),
        text(file, f"{key}.method", found["method"]),
        whole(file, f"{key}.examples", found["examples"]),
        number(file, f"{key}.margin", found["margin"]),
        number(file, f"{key}.relative_margin", found["relative_margin"]),
        optional("bound"),
        optional("settle"),
        optional("worst_case"),
        text(file, f"{key}.worst_case_weights", found.get("worst_case_weights", "")),
        tuple(_flip(file, f"{key}.flips", row) for row in _rows(found.get("flips", []))),
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
    mismatch, rate, low, high = (number(file, key, one) for one in row[:4])
    return FlipRate(mismatch, rate, low, high, whole(file, key, row[4]))
