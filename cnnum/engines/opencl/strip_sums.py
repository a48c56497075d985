"""The kernel text of the stages of fixed steps, as `strip_stages` has them."""

from cnnum.engines.opencl.strip_rows import At, Rows
from cnnum.engines.opencl.strip_settle import Watch
from cnnum.engines.opencl.strip_stages import Stage, Stages, Sum


def array_of(place: int) -> str:
    """Return the name of the array that keeps a state or a sum."""
    return f"strip_x{place}"


def sum_cases(
    rows: Rows, layers: tuple[Stages, ...], block: int, watch: Watch | None = None
) -> list[str]:
    """Return the text of all stages of so many rows; layers differ in their factors alone.

    The first stage is the one that is watched.
    """
    lines: list[str] = []
    for number, stage in enumerate(layers[0].stages):
        seen = watch if number == 0 else None
        own = tuple(float(stage.whole and seen is None) - scale for scale in rows.scales)
        each = rows.coupled(rows.block(block), own, array_of(stage.state))
        for at in rows.block(block):
            each += _end(rows, layers[at.layer].stages[number], at, seen)
        lines += rows.case(number, each, seen.head if seen else [], seen.tail if seen else [])
    return lines


def _end(rows: Rows, stage: Stage, at: At, seen: Watch | None) -> list[str]:
    """Return the text that makes the sums of a row, once its d is known."""
    limited, known = rows.text.template.output.limited, set[int]()
    whole = stage.whole and seen is None
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
        value = at.sum if whole else _sum(rows, one, at)
        lines.append(f"{'' if one.place in known else 'vec '}a{one.place} = {value};")
        known.add(one.place)
        if one is stage.sums[0]:
            lines += rows.show(at, f"a{one.place}")
        lines.append(rows.store(array_of(one.place), at, f"a{one.place}"))
    return ["{", *(f"    {line}" for line in lines), "}"]


def _sum(rows: Rows, one: Sum, at: At) -> str:
    terms = [(f"a{place}", factor) for place, factor in one.terms]
    return " + ".join(
        name if factor == 1.0 else f"{rows.vector(factor)} * {name}"
        for name, factor in [*terms, (at.sum, one.factor)]
    )
