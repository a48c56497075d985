"""Numbers, texts and matrices in TOML's spelling."""

import json
from collections.abc import Iterable

from cnnum.arrays import Floats


def value(item: float | str) -> str:
    """Return a number or a text."""
    return quoted(item) if isinstance(item, str) else repr(float(item))


def quoted(text: str) -> str:
    """Return a text in quotes."""
    # JSON and TOML escape alike but for DEL, and \u of a surrogate, which TOML does not know.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def yes_or_no(flag: bool) -> str:
    """Return true or false."""
    return "true" if flag else "false"


def several(values: Iterable[float]) -> str:
    """Return a list of numbers."""
    return f"[{', '.join(repr(float(item)) for item in values)}]"


def stacked(kernels: Floats) -> str:
    """Return weights (to, from, k, k), without the outer lists where both are 1."""
    if kernels.shape[:2] == (1, 1):
        return rows(kernels[0, 0])
    blocks = [", ".join(rows(block, "  ") for block in row) for row in kernels]
    return "[\n  " + ",\n  ".join(f"[{block}]" for block in blocks) + ",\n]"


def rows(block: Floats, indent: str = "") -> str:
    """Return a matrix, one row a line."""
    lines = "".join(f"{indent}  {several(row)},\n" for row in block)
    return f"[\n{lines}{indent}]"
