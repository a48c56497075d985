"""Options of `cnnum bench embedded`, and the runs that they ask for."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Any, cast

import click

from cnnum.cli.commands.export import shape_of
from cnnum.cli.options import force_option, json_option, results_option, together

if TYPE_CHECKING:
    from cnnum.lab.embedded.answer import Bounds
    from cnnum.lab.embedded.costs import Case

SUFFIXES = {"": 1.0, "k": 1e3, "m": 1e6, "g": 1e9}
KIB = {"": 1.0, "k": 1024.0, "m": 1024.0**2}


SEVERAL: dict[str, Any] = {"multiple": True, "metavar": "NAME"}

embedded_options = together(
    click.option("--program", "programs", **SEVERAL, help="slip and twist unless given."),
    click.option("--shape", "shapes", **SEVERAL, help="As 8x8x3, which it is unless given."),
    click.option("--precision", "precisions", **SEVERAL, help="q15, q7, q23 and float32."),
    click.option("--method", "methods", **SEVERAL, help="auto or euler; auto unless given."),
    click.option("--core", "cores", **SEVERAL, help="m0, m4 or m7; m4 unless given."),
    click.option("--clock", default="168MHz", show_default=True, help="Of the core."),
    click.option("--max-error", type=click.FloatRange(min=0, min_open=True), help="Bound."),
    click.option("--ram", help="Bound in bytes, as 32k."),
    click.option("--flash", help="Bound in bytes, as 128k."),
    click.option("--rate", help="Frames a second to reach, as 1kHz."),
    click.option("--quick", is_flag=True, help="q15 and q7 alone, and no scenes scored."),
    results_option,
    force_option,
    json_option,
)
"""Options of the command."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """Configurations to measure.

    Attributes
    ----------
    cases : list of Case
    clock : float
        Hz.
    scenes : int
        Of each kind, in which reports are scored.
    bounds : Bounds
    """

    cases: "list[Case]"
    clock: float
    scenes: int
    bounds: "Bounds"

    @classmethod
    def of(cls, asked: Mapping[str, object]) -> "Wanted":
        """Return the runs that options ask for.

        Raises
        ------
        click.UsageError
            If one is not understood.
        UnknownNameError
            If a program, a precision, a method or a core has another name.
        """
        from cnnum.embedded.formats import precision_named
        from cnnum.embedded.lowering.solvers import METHODS
        from cnnum.errors import name_error
        from cnnum.lab.embedded.answer import Bounds
        from cnnum.lab.embedded.cortex_m import CORES
        from cnnum.lab.embedded.costs import PRECISIONS, SCENES, USUAL, cases
        from cnnum.programs.library import get_program

        def names(key: str, usual: tuple[str, ...]) -> tuple[str, ...]:
            return cast("tuple[str, ...]", asked[key]) or usual

        quick = bool(asked["quick"])
        programs = names("programs", USUAL)
        precisions = names("precisions", PRECISIONS[:2] if quick else PRECISIONS)
        methods, cores = names("methods", ("auto",)), names("cores", ("m4",))
        for program in programs:
            get_program(program)
        for precision in precisions:
            precision_named(precision)
        for kind, some, known in (("method", methods, METHODS), ("core", cores, CORES)):
            for name in some:
                if name not in known:
                    raise name_error(kind, name, known)
        shapes = [shape_of(text) for text in names("shapes", ("8x8x3",))]
        bounds = Bounds(
            cast("float | None", asked["max_error"]) or inf,
            _amount("ram", asked, KIB, "") or inf,
            _amount("flash", asked, KIB, "") or inf,
            _amount("rate", asked, SUFFIXES, "hz"),
        )
        clock = _amount("clock", asked, SUFFIXES, "hz")
        some_cases = cases(programs, shapes, precisions, methods, cores)
        return cls(some_cases, clock, 0 if quick else SCENES, bounds)

    @property
    def label(self) -> str:
        """The runs, in words."""
        cores = sorted({case[-1] for case in self.cases})
        return f"Cortex {', '.join(core.upper() for core in cores)}, counted by Unicorn"


def _amount(
    key: str, asked: Mapping[str, object], suffixes: Mapping[str, float], unit: str
) -> float:
    """Return a number with a suffix; 0 where none is given."""
    given = asked[key]
    if given is None:
        return 0.0
    text = str(given).strip().lower().removesuffix(unit or "b")
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([kmg]?)(?:i?b?)", text)
    if found is None or found[2] not in suffixes or not float(found[1]) > 0.0:
        example = "168MHz" if unit else "32k"
        raise click.UsageError(f"--{key} is a number above 0, as {example}, got '{given!s:.40}'.")
    return float(found[1]) * suffixes[found[2]]
