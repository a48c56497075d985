"""`cnnum bench all`: the benchmarks in turn; one that lacks a library does not stop the others."""

from collections.abc import Mapping, Sequence

import click
from rich.text import Text

from cnnum.cli.following import STOPPED
from cnnum.cli.output import Output
from cnnum.errors import CnnumError, MissingExtraError
from cnnum.safety.names import visible

FAILED = 2
"""Exit code where a benchmark could not be run, as it would be of that benchmark alone."""


def run_all(
    ctx: click.Context,
    benchmarks: Mapping[str, click.Command],
    options: Mapping[str, object],
    output: Output,
) -> int:
    """Run benchmarks with the same options, name those that did not end, return a code.

    Parameters
    ----------
    ctx : click.Context
        Of the command that runs them.
    benchmarks : mapping
        In the order in which they run.
    options : mapping
        By parameter; others of a benchmark are as if they had not been given.
    output : Output

    Returns
    -------
    int
        0 where all have come to their end but for those that want an extra that is not
        installed. 130 where one was stopped, after which none begins. 2 where one has failed.
    """
    unfinished: dict[str, str] = {}
    names, code = list(benchmarks), 0
    for place, name in enumerate(names):
        output.show(Text(f"\ncnnum bench {name}", style="bold"))
        try:
            if _invoke(ctx, benchmarks[name], options) == STOPPED:
                unfinished[name] = "It was stopped."
                unfinished |= dict.fromkeys(names[place + 1 :], "It was not begun.")
                code = STOPPED
                break
        except MissingExtraError as missing:
            unfinished[name] = str(missing)
        except CnnumError as error:
            unfinished[name], code = str(error), FAILED
            click.echo(visible(f"cnnum bench {name}: {error}"), err=True)
    _summarise(output, names, unfinished)
    return code


def _invoke(ctx: click.Context, benchmark: click.Command, options: Mapping[str, object]) -> object:
    try:
        taken = {one.name for one in benchmark.params}
        given = {name: value for name, value in options.items() if name in taken}
        return ctx.invoke(benchmark, **given)
    except KeyboardInterrupt:  # before its first row, or after its last
        return STOPPED


def _summarise(output: Output, names: Sequence[str], unfinished: Mapping[str, str]) -> None:
    done = [name for name in names if name not in unfinished]
    output.record({"kind": "benchmarks", "run": done, "unfinished": unfinished})
    output.show(f"\nRun to the end: {', '.join(done) or 'nothing'}.\nNot run to the end:")
    lines = [f"  {name}: {reason}" for name, reason in unfinished.items()]
    output.show(*(lines or ["  nothing"]))
