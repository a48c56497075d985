"""Networks and programs that are stiff, marginal or extreme, each solved or rightly refused."""

from cnnum.lab.stability.record import Case, Row, Solved
from cnnum.lab.stability.runner import ENGINES, all_cases, run, run_case, select

__all__ = ("ENGINES", "Case", "Row", "Solved", "all_cases", "run", "run_case", "select")
