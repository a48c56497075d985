"""Every number and figure of the dissertation that a model can give, with the published one.

An `Item` is one published result and the function that computes ours. `run` makes a `Row` of it.
`write_report` puts the rows and the figures on one page.
"""

from cnnum.lab.reproduce.record import Item, Row
from cnnum.lab.reproduce.registry import item_names, run, select

__all__ = ["Item", "Row", "item_names", "run", "select"]
