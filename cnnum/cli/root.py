"""The commands by name, and their root, where an error becomes a sentence and an exit code.

A new command is one new file and one line in the table below. Its module, which holds the
command as `command`, is imported when the command is called, so that `cnnum --help` is quick.
Commands that measure and verify live in `cnnum.lab`, which an installation may leave out.
"""

import contextlib
import difflib
import io
import logging
import os
import sys
import traceback
import warnings
from collections.abc import Callable, Generator, Mapping, Sequence
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import Any, cast

import click

from cnnum.errors import CnnumError, RecordingWarning
from cnnum.safety.values import visible
from cnnum.version import __version__

ROOM = "cnnum.cli.commands"
LAB = "cnnum.lab"

_SERVING: Mapping[str, str] = {
    "demo": "Run a simulated scene and write a report.",
    "run": "Run a scene and print its events as they come.",
    "plan": "Show the operations of a scene and what it leaves out.",
    "templates": "List, show and check the template library.",
    "studio": "Edit a template in a browser and watch it run.",
    "sweep": "Sweep a template over weights, sizes and noise.",
    "devices": "Show the OpenCL devices and their speed.",
    "calibrate": "Fit the calibration of a taxel to a scan of point loads.",
    "probe": "Measure an array's rate, losses and dead cells.",
    "simulate": "Simulate an array at a serial port, with faults on request.",
    "export": "Write a program as C99 for a microcontroller.",
    "record": "Record an array's frames to a file.",
    "recover": "Rescue a recording that was cut off or damaged.",
    "check": "Check order, signs, rate, rest and taxels of a recording.",
    "layout": "Propose the layout of a data file, and draw a frame.",
    "lerobot": "Write a recording as a data set of LeRobot.",
    "ros": "Publish the frames and events of a scene in ROS 2.",
    "view": "Show an array or a recording in a browser.",
    "replay": "Run the program of a scene over a recording.",
    "tune": "Tune the level of an event to your own recordings.",
    "process": "Run a scene over many recordings, into a table of events.",
    "explain": "Explain why slip and twist are reported at a time, or not.",
}
"""The commands that serve: name, which is also that of the module, to the line of help."""


def _lab() -> Mapping[str, tuple[str, str]]:
    if find_spec(LAB) is None:
        return {}
    return cast("Mapping[str, tuple[str, str]]", import_module(f"{LAB}.commands").COMMANDS)


COMMANDS = {**{name: (f"{ROOM}.{name}", line) for name, line in _SERVING.items()}, **_lab()}
"""All commands of this installation."""


CHECKS_FAILED, WRONG_INPUT, OUR_FAULT, STOPPED, PIPE_CLOSED = 1, 2, 70, 130, 141
"""Exit codes: 70 is EX_SOFTWARE of ``sysexits.h``. The last two are those of a shell for a command
that a signal has ended."""

TRACEBACK = "CNNUM_TRACEBACK"
"""Variable of the environment that, set to 1, shows the traceback of a fault of cnnum itself."""

LONGEST = 2000
"""Signs of the longest sentence: a name in it can be as long as a file."""


class ClosedPipe(Exception):  # noqa: N818 - nothing went wrong
    """Whoever read our output has closed it; click would exit with 1, which is a failed check's."""


class Root(click.Group):
    """Finds commands by the registry, and ends every one of them in the same way."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Check that a shell can pass on the arguments, then read the options."""
        if any("\0" in argument for argument in args):
            raise click.UsageError("Arguments must not contain a NUL character.", ctx)
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        if cmd_name not in COMMANDS:
            return None
        return cast(click.Command, import_module(COMMANDS[cmd_name][0]).command)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that was asked for, or name the nearest one."""
        if args[0] not in COMMANDS and not args[0].startswith("-"):
            near = difflib.get_close_matches(args[0], COMMANDS, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"expected {', '.join(COMMANDS)}."
            raise click.UsageError(f"Unknown command '{args[0]}': {hint}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command that was found."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            raise ClosedPipe from None

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = "cnnum",
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        """Run a command and exit."""
        _open_standard_streams()
        for stream in (sys.stdout, sys.stderr):
            # a terminal that has no letter τ shall not end the command
            with contextlib.suppress(AttributeError):
                cast(Any, stream).reconfigure(errors="replace")
        run = partial(
            super().main,
            args=args,
            prog_name="cnnum",
            complete_var=complete_var,
            standalone_mode=False,
            windows_expand_args=windows_expand_args,
            **extra,
        )
        with _notices():
            code = _exit_code(run)
        sys.exit(code)


class _Notices(logging.Handler):
    """Writes the package's log as sentences on standard error, as errors are written."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a sentence."""
        _say(record.getMessage())


@contextlib.contextmanager
def _notices() -> Generator[None, None, None]:
    """Show the package's log, and its warnings of recordings, as sentences."""
    logger, handler = logging.getLogger("cnnum"), _Notices(logging.WARNING)
    logger.addHandler(handler)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _showing(warnings.showwarning)
            yield
    finally:
        logger.removeHandler(handler)


def _showing(usual: Callable[..., None]) -> Callable[..., None]:
    """Return a function that shows a recording's warning as a sentence, others as usual."""

    def show(
        message: Warning | str, category: type[Warning], *where: object, **more: object
    ) -> None:
        if issubclass(category, RecordingWarning):
            _say(str(message))
        else:
            usual(message, category, *where, **more)

    return show


def _exit_code(run: Callable[[], object]) -> int:
    try:
        code = run()
        sys.stdout.flush()
    except click.ClickException as error:
        return _say(_usage(error))
    except CnnumError as error:
        return _say(str(error))
    except (click.Abort, KeyboardInterrupt):
        return STOPPED
    except (ClosedPipe, BrokenPipeError):
        return _closed_pipe()
    except OSError as error:
        where = f"'{error.filename}': " if error.filename else ""
        _say(f"{where}{error.strerror or error}.")
        _drop_output()
        return WRONG_INPUT
    except Exception as error:  # a fault of ours, RecursionError and MemoryError too
        return _own_up(error)
    return code if isinstance(code, int) else 0


def _own_up(error: Exception) -> int:
    if os.environ.get(TRACEBACK, "") not in ("", "0"):
        traceback.print_exception(error)
    name = type(error).__name__
    message = f"{error!s:.300}".rstrip(".")
    said = f"{name}: {message}" if message else name
    _say(
        f"This is a fault of cnnum, not of your input ({said}): run the command again with "
        f"{TRACEBACK}=1 in the environment, and report the traceback to the maintainers of cnnum."
    )
    return OUR_FAULT


def _usage(error: click.ClickException) -> str:
    ctx = error.ctx if isinstance(error, click.UsageError) else None
    sentence = " ".join(error.format_message().split())
    return f"{sentence} ('{ctx.command_path} --help' shows how)" if ctx else sentence


def _say(sentence: str) -> int:
    # stdout first: a pipe that closed there has been reported already
    with contextlib.suppress(OSError):
        sys.stdout.flush()
    with contextlib.suppress(OSError):
        whole = visible(" ".join(sentence.split()))
        cut = whole if len(whole) <= LONGEST else f"{whole[:LONGEST]} …"
        print(f"cnnum: {cut}", file=sys.stderr, flush=True)
    return WRONG_INPUT


def _closed_pipe() -> int:
    """Be silent: whoever read our output has seen enough (`cnnum … | head`)."""
    _drop_output()
    return PIPE_CLOSED


def _drop_output() -> None:
    """Send text that still waits to nowhere: it would raise once more when Python ends."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


class _Nowhere(io.TextIOBase):
    """Takes what is written to a standard stream that was closed before we began."""

    def write(self, text: str, /) -> int:
        """Drop it."""
        return len(text)


def _open_standard_streams() -> None:
    """Put something in the place of closed standard streams.

    The next file that is opened would get the number of a closed one, and all that a library prints
    there. Python has no object for such a stream.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            with contextlib.suppress(OSError):
                os.open(os.devnull, os.O_RDWR)  # it gets the lowest number that is free
    sys.stdout = sys.stdout or _Nowhere()
    sys.stderr = sys.stderr or _Nowhere()


@click.group(
    cls=Root,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(__version__, prog_name="cnnum")
@click.pass_context
def main(ctx: click.Context) -> None:
    """Run tactile scenes on an emulated cellular-wave computer.

    Start with `cnnum demo`. With --json, every command prints one JSON object per line.
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())
