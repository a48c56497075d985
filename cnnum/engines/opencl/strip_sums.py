"""The kernel text of the stages of fixed steps, as `strip_stages` has them."""

from cnnum.engines.opencl.strip_rows import Rows
from cnnum.engines.opencl.strip_stages import Stage, Stages, Sum


def array_of(place: int) -> str:
    """Return the name of the array that keeps a state or a sum."""
    return f"strip_x{place}"


def sum_cases(rows: Rows, stages: Stages, block: int) -> list[str]:
    """Return the text of all stages of so many rows."""
    lines: list[str] = []
    for number, stage in enumerate(stages.stages):
        own = float(stage.whole) - rows.scale
        each = rows.coupled(block, own, array_of(stage.state))
        for row in range(block):
            each += _end(rows, stage, row)
        lines += rows.case(number, each)
    return lines


def _end(rows: Rows, stage: Stage, row: int) -> list[str]:
    """Return the text that makes the sums of a row, once its d is known."""
    limited, known = rows.text.template.output.limited, set[int]()
    if not stage.whole:
        known |= {place for one in stage.sums for place, _ in one.terms}
        known |= {stage.state} if limited else set[int]()
    lines = [f"vec a{place} = {rows.array(array_of(place), row)};" for place in sorted(known)]
    if limited and not stage.whole:
        lines.append(f"s{row} = inwards(s{row}, a{stage.state}, one);")
    for one in stage.sums:
        value = f"s{row}" if stage.whole else _sum(rows, one, row)
        lines.append(f"{'' if one.place in known else 'vec '}a{one.place} = {value};")
        known.add(one.place)
        if one is stage.sums[0]:
            lines += rows.show(row, f"a{one.place}")
        lines.append(rows.store(array_of(one.place), row, f"a{one.place}"))
    return ["{", *(f"    {line}" for line in lines), "}"]


def _sum(rows: Rows, one: Sum, row: int) -> str:
    terms = [(f"a{place}", factor) for place, factor in one.terms]
    return " + ".join(
        name if factor == 1.0 else f"{rows.vector(factor)} * {name}"
        for name, factor in [*terms, (f"s{row}", one.factor)]
    )
