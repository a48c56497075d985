"""Templates from rules by linear programming, in floating point and exactly.

The weights of the largest relative margin, by a linear program, with a certificate.

A cell becomes black where Σ p·q > 0: q are the cells it sees, ±1, and a constant 1; p are weights
and bias. With every weight off by the share δ of itself, the sum moves by at most δ Σ |p|. The
smallest sum over Σ |p| is thus the mismatch up to which no sum changes its sign (Hänggi & Moschytz
1999). A template has an own feedback besides, which is off as well, and a duration:
`cnnum.design.worst_case` takes both into account.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from cnnum.arrays import Floats
from cnnum.design.local_rules import FIVE, NINE, Seen, Source, Table, WideRule
from cnnum.design.search import Advance, Watch, go_on
from cnnum.errors import TemplateError
from cnnum.templating.template import Check, Initial, Template

SEPARATED = 1e-7
"""Relative margins above it are none of a solver's rounding, which keeps to 1e-9 here."""

DENOMINATORS = 1000

TURNS: Sequence[Callable[[int, int], tuple[int, int]]] = (
    lambda down, east: (down, -east),
    lambda down, east: (-down, east),
    lambda down, east: (east, down),
    lambda down, east: (-east, -down),
    lambda down, east: (east, -down),
    lambda down, east: (-down, -east),
)
"""Reflections and rotations of the plane about a cell."""


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """Weights of a margin of 1, and the proof that no others have a larger relative margin.

    Attributes
    ----------
    seen : tuple of Seen
        The cell that each of `values` weighs.
    values : (columns,) float
    bias : float
    relative : float
        Margin over the sum of all sizes.
    bound : float
        No weights have more, by the multipliers of the linear program.
    exact : bool
        Whether the weights are ratios of whole numbers that were checked without rounding.
    """

    seen: tuple[Seen, ...]
    values: Floats
    bias: float
    relative: float
    bound: float
    exact: bool

    def of(self, source: Source, down: int = 0, east: int = 0) -> float:
        """Return a weight, 0 where nothing is weighed."""
        result: dict[Seen, float] = dict(zip(self.seen, self.values.tolist(), strict=True))
        return result.get(Seen(source, down, east), 0.0)

    def sums(self, table: Table) -> Floats:
        """Return Σ p·q of every configuration."""
        return np.asarray(table.signs @ self.values + self.bias, dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Conflict:
    """Proof that no weights separate the colours: a convex combination that cancels.

    Attributes
    ----------
    signs : (configurations, columns) float
    colours, shares : (configurations,) float
    """

    seen: tuple[Seen, ...]
    signs: Floats
    colours: Floats
    shares: Floats

    @property
    def why(self) -> str:
        """A sentence."""
        black = int((self.colours > 0.0).sum())
        return (
            f"{black} black and {len(self.colours) - black} white neighbourhoods have the same "
            "weighted mean, so that no plane lies between them"
        )


def separate(table: Table, *, symmetric: bool = True) -> Weights | Conflict:
    """Return the weights of the largest relative margin, or why there are none.

    Weights of neighbours' outputs are not negative, so that cells only pull each other along.

    Parameters
    ----------
    table : Table
    symmetric : bool
        Give equal weights to neighbours that a mirror or a quarter turn exchanges without a change
        of the rule. No margin is lost: the mean of two solutions is one.
    """
    from scipy.optimize import linprog

    rows = np.column_stack([table.signs, np.ones(len(table.signs))])
    signed = table.colours[:, np.newaxis] * rows
    count, columns = signed.shape
    # p = plus − minus, and the margin
    above = np.column_stack([-signed, signed, np.ones(count)])
    size = np.append(np.ones(2 * columns), 0.0)
    equal = equalities(table, columns) if symmetric else np.zeros((0, 2 * columns + 1))
    pulls = [seen.source != "u" for seen in table.seen] + [False]
    bounds = [(0.0, None)] * columns + [(0.0, 0.0 if pull else None) for pull in pulls]
    solution = linprog(
        np.append(np.zeros(2 * columns), -1.0),
        A_ub=np.vstack([above, size]),
        b_ub=np.append(np.zeros(count), 1.0),
        A_eq=equal if len(equal) else None,
        b_eq=np.zeros(len(equal)) if len(equal) else None,
        bounds=[*bounds, (0.0, None)],
        method="highs",
    )
    shares = -np.asarray(solution.ineqlin.marginals)[:count]
    shares = np.maximum(shares, 0.0) / max(shares.sum(), 1e-300)
    at: Floats = np.asarray(solution.x, dtype=np.float64)
    margin = float(at[-1])
    if margin <= SEPARATED:
        return conflict(table)
    values = (at[:columns] - at[columns : 2 * columns]) / margin
    return _weights(table, signed, values, _bound(table, shares, signed, symmetric=symmetric))


NEAR = 1e-9
"""Of the margin, by which a neighbourhood that was not drawn may be narrower."""


def separate_wide(
    rule: WideRule, *, seed: int = 0, watch: Watch = go_on
) -> tuple[Weights | Conflict, Table]:
    """Return the weights of the largest relative margin for a rule of 5×5 cells, and their table.

    The linear program sees drawn neighbourhoods. A search through all of them for the narrowest one
    then either proves its margin, or gives it neighbourhoods to see as well (cutting planes,
    Kelley 1960). A bound for some neighbourhoods is one for all.

    Parameters
    ----------
    rule : WideRule
    seed : int
    watch : callable
        Is given the margin over all neighbourhoods, of 1 over those seen.

    Raises
    ------
    KeyboardInterrupt
        If `watch` ends it: weights are right at its end alone.
    """
    table, turn = rule.drawn(np.random.default_rng(seed)), 0
    while True:
        turn += 1
        result = separate(table)
        if isinstance(result, Conflict):
            return result, table
        worst = rule.table(rule.narrowest(result.values))
        margin = float((worst.colours * result.sums(worst)).min())
        if margin >= 1.0 - NEAR:
            return result, table
        if not watch(Advance(turn, None, "round", margin, "margin proven, of 1,")):
            raise KeyboardInterrupt
        signs = np.concatenate([table.signs, worst.signs])
        colours = np.concatenate([table.colours, worst.colours])
        table = Table(table.seen, *_without_repeats(signs, colours))


def _without_repeats(signs: Floats, colours: Floats) -> tuple[Floats, Floats]:
    rows, first = np.unique(signs, axis=0, return_index=True)
    return rows, colours[first]


def conflict(table: Table) -> Conflict:
    """Return few configurations whose signed mean is 0."""
    from scipy.optimize import linprog

    rows = np.column_stack([table.signs, np.ones(len(table.signs))])
    signed = table.colours[:, np.newaxis] * rows
    # weights of outputs may not be negative: their columns may mean less than 0
    pulls = np.array([seen.source != "u" for seen in table.seen] + [False])
    solution = linprog(
        np.zeros(len(signed)),
        A_eq=np.vstack([signed.T[~pulls], np.ones(len(signed))]),
        b_eq=np.append(np.zeros(int((~pulls).sum())), 1.0),
        A_ub=signed.T[pulls] if pulls.any() else None,
        b_ub=np.zeros(int(pulls.sum())) if pulls.any() else None,
        method="highs-ds",
    )
    shares = np.asarray(solution.x)
    used = shares > 1e-12
    return Conflict(table.seen, table.signs[used], table.colours[used], shares[used])


def _weights(table: Table, signed: Floats, values: Floats, bound: float) -> Weights:
    """Return weights as ratios of whole numbers where those have the margin too."""
    ratios = [Fraction(float(v)).limit_denominator(DENOMINATORS) for v in values]
    whole = np.lcm.reduce([ratio.denominator for ratio in ratios])
    scaled = np.array([int(ratio * int(whole)) for ratio in ratios], dtype=np.int64)
    binary = bool(np.isin(signed, (-1.0, 1.0)).all())
    near = float(np.abs(scaled / whole - values).max()) < 1e-6
    exact = binary and near and bool((signed.astype(np.int64) @ scaled >= whole).all())
    taken = scaled / whole if exact else values
    margin = float((signed @ taken).min())
    taken = taken / margin
    relative = 1.0 / float(np.abs(taken).sum())
    return Weights(table.seen, taken[:-1], float(taken[-1]), relative, bound, exact)


def _bound(table: Table, shares: Floats, signed: Floats, *, symmetric: bool) -> float:
    """Return a bound on relative margins: the largest mean column, its mirror images merged."""
    mean = shares @ signed
    pulls = np.array([seen.source != "u" for seen in table.seen] + [False])
    orbits = _orbits(table) if symmetric else [[k] for k in range(len(mean))]
    merged = mean.copy()
    for orbit in orbits:
        merged[orbit] = mean[orbit].mean()
    sizes = np.where(pulls, np.maximum(merged, 0.0), np.abs(merged))
    return float(sizes.max())


def equalities(table: Table, columns: int) -> Floats:
    """Return rows that are 0 where weights of one orbit are equal."""
    result = list[Floats]()
    for first, *others in _orbits(table):
        for other in others:
            for offset in (0, columns):
                row = np.zeros(2 * columns + 1)
                row[offset + first], row[offset + other] = 1.0, -1.0
                result.append(row)
    return np.array(result).reshape(-1, 2 * columns + 1)


def _orbits(table: Table) -> list[list[int]]:
    """Return the columns (and the bias) in groups that symmetries of the rule exchange."""
    at = {seen: k for k, seen in enumerate(table.seen)}
    group = list(range(len(at) + 1))
    for turn in TURNS:
        image = [Seen(s.source, *turn(s.down, s.east)) for s in table.seen]
        if all(cell in at for cell in image):
            order = [at[cell] for cell in image]
            if _same(table, order):
                for k, other in enumerate(order):
                    low, high = sorted((group[k], group[other]))
                    group = [low if g == high else g for g in group]
    return [[k for k in range(len(group)) if group[k] == g] for g in sorted(set(group))]


def _same(table: Table, order: list[int]) -> bool:
    both = np.column_stack([table.signs, table.colours])
    turned = np.column_stack([table.signs[:, order], table.colours])
    return np.array_equal(np.unique(both, axis=0), np.unique(turned, axis=0))


HELD = 1.0
"""Of the own feedback above 1 where a cell need not keep its colour: it ends black or white."""

SPARE = 2.0
"""Run time over the longest that a cell of exact weights takes."""

SOURCE = "designed from its local rule by a linear program of the largest relative margin"


@dataclass(frozen=True, slots=True)
class Shape:
    """Properties of a template that a rule does not determine.

    Attributes
    ----------
    name, description : str
    boundary : float or str
    initial : float or "input"
    margin : float
        Smallest drive of a cell that decides; all weights scale with it.
    check : Check or None
    """

    name: str
    description: str = ""
    boundary: float | str = -1.0
    initial: Initial = 0.0
    margin: float = 1.0
    check: Check | None = None


def design(table: Table, shape: Shape) -> tuple[Template, Weights]:
    """Return the template of the largest relative margin for a local rule, and its weights.

    Raises
    ------
    TemplateError
        If no single template implements the rule; the message gives the reason.
    """
    result = separate(table)
    if isinstance(result, Conflict):
        raise TemplateError(
            f"No single template computes '{shape.name}': {result.why}. Split it into a sequence "
            "with split = true, or enlarge the neighbourhood."
        )
    return as_template(result, shape), result


def as_template(weights: Weights, shape: Shape) -> Template:
    """Return the template of weights; it rests after a run of its duration."""
    scale = shape.margin
    coupled = any(seen.source == "y" for seen in weights.seen)
    places = FIVE if any(max(abs(seen.down), abs(seen.east)) > 1 for seen in weights.seen) else NINE
    side = round(math.sqrt(len(places)))
    feedback = scale * np.array([weights.of("y", *at) for at in NINE]).reshape(3, 3)
    control = scale * np.array([weights.of("u", *at) for at in places]).reshape(side, side)
    before = scale * weights.of("before")
    feedback[1, 1] += 1.0 + (0.0 if coupled else before or HELD)
    return Template(
        shape.name,
        feedback,
        control if control.any() or not coupled else None,
        scale * weights.bias,
        boundary=shape.boundary,
        initial=shape.initial,
        duration="settle" if coupled else _duration(scale, before),
        description=shape.description,
        source=SOURCE,
        check=shape.check,
    )


def settle_bound(margin: float, before: float) -> float:
    """Return the longest time until a cell is black or white, in time constants.

    Within the linear range dx/dt = k x + w, with k = a − 1: from x = 0 the drive w ≥ margin takes
    ln(1 + k/w)/k to 1. From the rail of the other colour, where the rate is the margin, it takes
    ln(1 + 2k/margin)/k.
    """
    k = before or HELD
    return math.log1p((2.0 if before else 1.0) * k / margin) / k


def duration_from_rails(margin: float) -> float:
    """Return a duration after which cells that start black or white do not matter any more.

    From the rail of the other colour, dx/dt = k x + w with w ≥ margin takes ln((w + k)/(w − k))/k
    to the rail of its own.
    """
    passed = math.log((margin + HELD) / (margin - HELD)) / HELD
    return max(1.0, math.ceil(10.0 * SPARE * passed) / 10.0)


def _duration(margin: float, before: float) -> float:
    # a state beyond ±1 after it does not matter: the output is black or white
    return max(1.0, math.ceil(10.0 * SPARE * settle_bound(margin, before)) / 10.0)
