"""The kernel text of a small array's read-outs, such as sums: several chains side by side.

A sum that runs through the cells one by one waits four cycles for each of them, and as compilers
may not change its order, they work out all that shares its loop one cell at a time. Every kernel of
a plan sums up in the same order, so that a frame's results do not depend on those beside it.
"""

from cnnum.engines.opencl.storage import Tables
from cnnum.engines.opencl.text import fill, indented, rename
from cnnum.graph.elementwise import SUM, ReduceOp

CHAINS = 8
"""Of 4, 8 and 16 chains single frames take as long, and with 16 large batches take 1 % more."""


def chains(cells: int) -> int:
    """Return how many chains read out an array, or a stack of them."""
    return min(CHAINS, cells)


def rounds(function: ReduceOp) -> bool:
    """Return whether the order matters: what others read out is one of the numbers."""
    return function is SUM


def chained(tables: Tables, function: ReduceOp, count: int, cells: int) -> str:
    """Return the name of the kernel's function that reads one number out of so many.

    Parameters
    ----------
    tables : Tables
        Gets the function's text.
    function : ReduceOp
    count : int
        Of the numbers, in private memory.
    cells : int
        Of the array.
    """
    name = f"{function.name}_of_{count}"
    if name not in tables.types:
        tables.types[name] = fill(
            "chained",
            read_out=function.name,
            count=count,
            chains=chains(cells),
            function=name,
            body=indented(_body(function, count, chains(cells)), 1),
        )
    return name


def step(function: ReduceOp, total: str, value: str) -> str:
    """Return the expression that takes a value into a total."""
    return rename(function.step, {"total": total, "a": value})


def _body(function: ReduceOp, count: int, width: int) -> list[str]:
    last = count // width * width
    one = step(function, "chain[k]", "numbers[at + k]")
    rest = step(function, "chain[k]", f"numbers[{last} + k]")
    lines = [
        f"real chain[{width}];",
        f"for (int k = 0; k < {width}; ++k) {{ chain[k] = numbers[k]; }}",
        f"for (int at = {width}; at < {last}; at += {width}) {{",
        f"    for (int k = 0; k < {width}; ++k) {{ chain[k] = {one}; }}",
        "}",
        f"for (int k = 0; k < {count - last}; ++k) {{ chain[k] = {rest}; }}",
    ]
    while width > 1:
        half = (width + 1) // 2
        both = step(function, "chain[k]", f"chain[{half} + k]")
        lines.append(f"for (int k = 0; k < {width - half}; ++k) {{ chain[k] = {both}; }}")
        width = half
    return [*lines, "return chain[0];"]
