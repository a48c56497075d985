"""Kernels as records: expressions, statements, and the printer of OpenCL C.

Other rooms name the records by this one: `ir.Sweep`, `ir.pick`.
"""

from cnnum.kernels.expressions import (
    CELL,
    ONE,
    PLACE,
    ROUND,
    ZERO,
    Binary,
    Call,
    Cast,
    Choice,
    Component,
    Constant,
    Element,
    Expression,
    Integer,
    Load,
    Name,
    Negative,
    Number,
    Operand,
    after,
    call,
    clip,
    pick,
    real,
    shifted,
    size,
    total,
)
from cnnum.kernels.statements import (
    Accumulate,
    Array,
    Assign,
    Block,
    Branch,
    Counted,
    Declare,
    Loop,
    Note,
    Statement,
    Store,
    StripSteps,
    Sweep,
    Verbatim,
    While,
    add,
    block,
    declare,
    fixed,
    sweep,
)

__all__ = [
    "CELL", "ONE", "PLACE", "ROUND", "ZERO", "Accumulate", "Array", "Assign", "Binary", "Block",
    "Branch", "Call", "Cast", "Choice", "Component", "Constant", "Counted", "Declare", "Element",
    "Expression", "Integer", "Load", "Loop", "Name", "Negative", "Note", "Number", "Operand",
    "Statement", "Store", "StripSteps", "Sweep", "Verbatim", "While", "add", "after", "block",
    "call", "clip", "declare", "fixed", "pick", "real", "shifted", "size", "sweep", "total",
]  # fmt: skip
