"""The kernel text of the stages of fixed steps, as `strip_stages` has them."""

from cnnum.engines.opencl.large_arrays.strip_couplings import PART, coupled
from cnnum.engines.opencl.large_arrays.strip_rows import At, Rows
from cnnum.engines.opencl.large_arrays.strip_settling import Watch
from cnnum.engines.opencl.large_arrays.strip_stages import Stage, Stages, Sum
from cnnum.engines.opencl.large_arrays.strip_times import Moments


def array_of(place: int) -> str:
    """Return the name of the array that keeps a state or a sum."""
    return f"strip_x{place}"


def sum_cases(
    rows: Rows,
    layers: tuple[Stages, ...],
    block: int,
    moments: Moments,
    watch: Watch | None = None,
) -> list[str]:
    """Return the text of all stages of a number of rows; layers differ in their factors alone.

    The first stage is the one that is watched.
    """
    lines: list[str] = []
    for number, stage in enumerate(layers[0].stages):
        seen = watch if number == 0 else None
        whole = stage.whole and seen is None and not moments.uneven
        own = tuple(float(whole) - scale for scale in rows.scales)
        state, between = array_of(stage.state), moments.between(number)
        each = coupled(rows, rows.block(block), own, state, between=between)
        share = f"{PART} * " if moments.uneven else ""
        for at in rows.block(block):
            each += _end(rows, layers[at.layer].stages[number], at, seen, whole, share)
        head = [*moments.head(number), *(seen.head if seen else [])]
        lines += rows.case(number, each, head, seen.tail if seen else [])
    return lines


def _end(
    rows: Rows, stage: Stage, at: At, seen: Watch | None, whole: bool, share: str
) -> list[str]:
    """Return the text that makes the sums of a row, once its d is known.

    Where `whole`, its sum is the new state; else d comes with a `share`.
    """
    limited, known = rows.text.template.output.limited, set[int]()
    if not whole:
        known |= {place for one in stage.sums for place, _ in one.terms}
        known |= {stage.state} if limited or seen else set[int]()
    lines = [f"vec a{place} = {rows.array(array_of(place), at)};" for place in sorted(known)]
    if limited and not whole:
        lines.append(f"{at.sum} = inwards({at.sum}, a{stage.state}, one);")
    if rows.masked:
        still = rows.array(array_of(stage.state), at) if whole else "one - one"
        lines.append(f"{at.sum} = {rows.free(at, at.sum, still)};")
    if seen:
        lines += seen.sees(at, f"a{stage.state}")
    for one in stage.sums:
        value = at.sum if whole else _sum(rows, one, at, share)
        lines.append(f"{'' if one.place in known else 'vec '}a{one.place} = {value};")
        known.add(one.place)
        if one is stage.sums[0]:
            lines += rows.show(at, f"a{one.place}")
        lines.append(rows.store(array_of(one.place), at, f"a{one.place}"))
    return ["{", *(f"    {line}" for line in lines), "}"]


def _sum(rows: Rows, one: Sum, at: At, share: str) -> str:
    terms = [(f"a{place}", factor) for place, factor in one.terms]
    return " + ".join(
        name if factor == 1.0 else f"{rows.vector(factor)} * {name}"
        for name, factor in [*terms, (f"{share}{at.sum}", one.factor)]
    )
