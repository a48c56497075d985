"""The pass that leaves out variables that nothing reads."""

from collections.abc import Sequence
from dataclasses import replace

from cnnum.kernels.expressions import Element, Expression, Name
from cnnum.kernels.statements import Accumulate, Assign, Counted, Declare, Loop, Statement, Sweep
from cnnum.kernels.uses import names_in, names_of_own


def live(body: Sequence[Statement], needed: set[str]) -> tuple[Statement, ...]:
    """Return statements without variables that nothing reads; `needed` gathers the read ones.

    Numbers of arrays, and variables from outside, are outputs: they are always set.
    """
    return _live(body, needed, names_of_own(tuple(body)))


def _live(body: Sequence[Statement], needed: set[str], own: set[str]) -> tuple[Statement, ...]:
    """Return the live statements of a block; `own` are the variables that the body declares."""
    kept = list[Statement]()
    for statement in reversed(body):
        if isinstance(statement, Sweep | Loop | Counted):
            found = _live_block(statement, needed, own)
        elif isinstance(statement, Declare):
            found = _live_variables(statement, needed)
        else:
            found = statement if _sets(statement, needed, own) else None
        if found is not None:
            kept.append(found)
    return tuple(kept[::-1])


def _live_variables(new: Declare, needed: set[str]) -> Declare | None:
    variables = list[tuple[Name, Expression | None]]()
    for name, value in reversed(new.variables):
        if name.text in needed:
            needed.discard(name.text)  # another one by that name may stand in another loop
            needed |= names_in(value)
            variables.insert(0, (name, value))
    return replace(new, variables=tuple(variables)) if variables else None


def _sets(statement: Statement, needed: set[str], own: set[str]) -> bool:
    """Return whether a statement has an effect; the names it reads become needed."""
    assert isinstance(statement, Assign | Accumulate)
    target = statement.target
    adds = isinstance(statement, Accumulate) or statement.sign != "="
    if isinstance(target, Name) and target.text not in needed and (adds or target.text in own):
        return False
    needed |= names_in(statement.value)
    if isinstance(target, Element):
        needed |= names_in(target.at)
    return True


def _live_block(
    statement: Sweep | Loop | Counted, needed: set[str], own: set[str]
) -> Statement | None:
    outer = statement.variable.text in needed
    if isinstance(statement, Counted):
        if statement.running is not None:
            needed.add(statement.running.text)
        # a round may read variables that the one before has set, and so on
        known = -1
        while known < len(needed):
            known = len(needed)
            _within(statement.body, needed, own)
    inner = _within(statement.body, needed, own)
    if not outer:  # a loop's own variable: one by that name before the loop is another
        needed.discard(statement.variable.text)
    return replace(statement, body=inner) if inner else None


def _within(body: Sequence[Statement], needed: set[str], own: set[str]) -> tuple[Statement, ...]:
    """Return the live statements of a block, whose own variables are not known outside."""
    inner = set(needed)
    found = _live(body, inner, own)
    needed |= inner
    return found
