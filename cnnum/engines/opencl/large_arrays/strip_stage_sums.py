"""The stages of fixed steps, as `cnnum.integrators.schemes` has them."""

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_couplings import PART, coupled
from cnnum.engines.opencl.large_arrays.strip_rows import ONES, At, Rows, vector
from cnnum.engines.opencl.large_arrays.strip_settling import Watch
from cnnum.engines.opencl.large_arrays.strip_times import Moments
from cnnum.integrators.schemes import Stage, Stages, Sum


def array_of(place: int) -> str:
    """Return the name of the array that keeps a state or a sum."""
    return f"strip_x{place}"


def sum_cases(
    rows: Rows,
    layers: tuple[Stages, ...],
    block: int,
    moments: Moments,
    watch: Watch | None = None,
) -> list[ir.Case]:
    """Return all stages of a number of rows; layers differ in their factors alone.

    The first stage is the one that is watched.
    """
    cases = list[ir.Case]()
    for number, stage in enumerate(layers[0].stages):
        seen = watch if number == 0 else None
        whole = stage.whole and seen is None and not moments.uneven
        own = tuple(float(whole) - scale for scale in rows.scales)
        state, between = array_of(stage.state), moments.between(number)
        each = coupled(rows, rows.block(block), own, state, between=between)
        share = PART if moments.uneven else None
        for at in rows.block(block):
            each.append(_end(rows, layers[at.layer].stages[number], at, seen, whole, share))
        head = [*moments.head(number), *(seen.head if seen else [])]
        cases.append(rows.case(number, each, head, seen.tail if seen else []))
    return cases


def _end(
    rows: Rows, stage: Stage, at: At, seen: Watch | None, whole: bool, share: ir.Name | None
) -> ir.Block:
    """Return the statements that make the sums of a row, once its d is known.

    Where `whole`, its sum is the new state; else d comes with a `share`.
    """
    limited, known = rows.text.template.output.limited, set[int]()
    if not whole:
        known |= {place for one in stage.sums for place, _ in one.terms}
        known |= {stage.state} if limited or seen else set[int]()
    lines = [vector(_kept(place), rows.array(array_of(place), at)) for place in sorted(known)]
    if limited and not whole:
        lines.append(ir.Assign(at.sum, ir.call("inwards", at.sum, _kept(stage.state), ONES)))
    if rows.masked:
        still = rows.array(array_of(stage.state), at) if whole else ONES - ONES
        lines.append(ir.Assign(at.sum, rows.free(at, at.sum, still)))
    if seen:
        lines += seen.sees(at, _kept(stage.state))
    for one in stage.sums:
        kept, value = _kept(one.place), at.sum if whole else _sum(one, at, share)
        lines.append(ir.Assign(kept, value) if one.place in known else vector(kept, value))
        known.add(one.place)
        if one is stage.sums[0]:
            lines += rows.show(at, kept)
        lines.append(rows.store(array_of(one.place), at, kept))
    return ir.block(*lines)


def _kept(place: int) -> ir.Name:
    return ir.Name(f"a{place}")


def _sum(one: Sum, at: At, share: ir.Name | None) -> ir.Expression:
    terms = [_weighted([_kept(place)], factor) for place, factor in one.terms]
    own: list[ir.Expression] = [at.sum] if share is None else [share, at.sum]
    return ir.total([*terms, _weighted(own, one.factor)])


def _weighted(factors: list[ir.Expression], weight: float) -> ir.Expression:
    first, *others = factors if weight == 1.0 else [ir.Number(weight), *factors]
    for factor in others:
        first = first * factor
    return first
