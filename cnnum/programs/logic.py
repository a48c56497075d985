"""Local logic by truth table: all sixteen functions of two logic values."""

from cnnum.errors import ProgramError
from cnnum.programs.fields import Field
from cnnum.safety.values import expect


def logic(table: str, a: Field, b: Field) -> Field:
    """Return one of the sixteen logic functions of two logic maps or flags.

    Parameters
    ----------
    table : str
        The function's values for (a, b) = (0, 0), (0, 1), (1, 0), (1, 1): "0001" is AND, "0111"
        OR, "0110" XOR, "1110" NAND, "1101" a → b…
    a, b : logic Field

    Raises
    ------
    ProgramError
        If the table is not four of 0 and 1, or a or b is no logic field.
    """
    for name, value, kind in (("table", table, str), ("a", a, Field), ("b", b, Field)):
        expect(name, value, kind, ProgramError)
    if len(table) != 4 or set(table) - {"0", "1"}:
        raise ProgramError(
            f"A logic table must be four digits of 0 and 1, such as '0110', got {table!r:.60}."
        )
    minterms = [~a & ~b, ~a & b, a & ~b, a & b]
    wanted = [term for term, value in zip(minterms, table, strict=True) if value == "1"]
    total = a & ~a
    for term in wanted:
        total = total | term
    return total
