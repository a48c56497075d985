"""`cnnum templates show` and `gallery`: templates to look at."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cnnum.cli.commands.templates_convert import chosen, is_place
from cnnum.cli.options import completed, file_option, force_option, json_option, target_option
from cnnum.cli.output import Output, facts, number, progress

if TYPE_CHECKING:
    from cnnum.templating.couplings import NonlinearCoupling
    from cnnum.templating.files import Entry
    from cnnum.templating.template import Template


@click.command("show")
@click.argument("name", shell_complete=completed("template"))
@target_option(
    "--transient",
    "FILE.html|png|svg|gif|mp4|webm",
    "Run it on a picture, and write its state or output at several times.",
)
@click.option(
    "--input",
    "picture",
    type=click.Path(path_type=Path),
    help="Picture to run it on; by default a ring, a bar and a dot.",
)
@click.option(
    "--times", type=click.IntRange(2, 1000), default=13, show_default=True, help="Number of times."
)
@click.option("--engine", help="Engine to run on: opencl, numba or reference.")
@force_option
@json_option
def show(
    name: str,
    transient: Path | None,
    picture: Path | None,
    times: int,
    engine: str | None,
    force: bool,
    as_json: bool,
) -> None:
    """Show the template NAME (of the library, or a file) with its numbers and properties."""
    if transient is not None:
        _refuse_unknown_kind(transient)
    elif picture is not None:
        raise click.UsageError(
            f"'{picture}' is the picture of a run: name its file, as in --transient {name}.html."
        )
    shown = _picture(picture) if transient is not None else None
    from cnnum.templating.files import load_entry
    from cnnum.templating.library import get_entry

    entry = load_entry(name) if is_place(name) else get_entry(name)
    template, output = entry.template, Output(as_json)
    output.record({**_record(template), **_words(entry)})
    output.show(facts([*_facts(template), *_known(entry)]), "")
    from cnnum.templating.numbers import functions, matrices

    for label, kernel in matrices(template):
        output.show(f"{label} =", _matrix(kernel.tolist()), "")
    for label, text in functions(template):
        output.show(f"{label}: {text}", "")

    if transient is not None:
        _write_transient(template, transient, shown, times, engine, force)
        output.record({"kind": "transient", "file": str(transient)}, f"Written: {transient}")


def _refuse_unknown_kind(path: Path) -> None:
    from cnnum.errors import name_error
    from cnnum.pictures import FILMS, film_kind
    from cnnum.report.run_pages import WRITERS

    if path.suffix.lower() in FILMS:
        film_kind(path)
    elif path.suffix.lower() not in WRITERS:
        raise name_error("kind of picture", path.suffix or path.name, WRITERS)


def _picture(path: Path | None) -> Any:
    """Return the picture of a file, or one that shows most templates at work."""
    from cnnum.pictures import load_picture
    from cnnum.report.run_pages import default_picture

    return default_picture() if path is None else load_picture(path)


def _write_transient(
    template: "Template", path: Path, shown: Any, times: int, engine: str | None, force: bool
) -> None:
    from cnnum.engine import Engine
    from cnnum.report.run_pages import transient_of, write_transient

    at, result = transient_of(Engine(engine), template, shown, times)
    write_transient(path, template, at, result, force=force)


def _words(entry: "Entry") -> dict[str, object]:
    """Return the facts of a template's file, and its measured figures."""
    measured = entry.measured
    return {
        "input": entry.about.input,
        "state": entry.about.state,
        "tags": list(entry.about.tags),
        "experimental": entry.about.experimental,
        "published_boundary": entry.about.published_boundary,
        "settle": measured.settle if measured else (),
        "margin": measured.margin if measured else None,
    }


def _known(entry: "Entry") -> list[tuple[str, str]]:
    from cnnum.templating.checks.running import unsettled

    about, measured = entry.about, entry.measured
    times = measured.settle if measured else ()
    margin = measured.margin if measured else None
    why = unsettled(entry.template, measured) if measured and entry.template.check else ""
    lines = [
        ("input", about.input),
        ("state", about.state),
        ("tags", ", ".join(about.tags)),
        ("experimental", " ".join(about.experimental.split())),
        ("published boundary", about.published_boundary),
        ("settles within", ", ".join(f"{n}×{n}: {entry.template.timed(t, 3)}" for n, t in times)),
        ("no settle time", why),
        ("margin of the bias", "" if margin is None else number(margin)),
    ]
    return [(label, text) for label, text in lines if text]


def _record(template: "Template") -> dict[str, object]:
    check, late = template.check, template.delayed
    return {
        "template": template.name,
        "description": template.description,
        "source": template.source,
        "A": template.A.tolist(),
        "B": template.B.tolist(),
        "z": template.z.tolist(),
        "tau": template.tau.tolist(),
        "boundary": template.boundary.name,
        "input_boundary": template.input_boundary.name,
        "initial": template.initial,
        "duration": template.duration,
        "output": template.output.name,
        "nonlinear": [_coupling(part) for part in template.nonlinear],
        "delayed": None
        if late is None
        else {"delay": late.delay, "A": late.A.tolist(), "B": late.B.tolist()},
        "gains": [
            {"to": gain.to, "source": gain.source, "points": gain.table.points}
            for gain in template.gains
        ],
        "check": {"name": check.name, **dict(check.parameters)} if check else None,
    }


def _coupling(coupling: "NonlinearCoupling") -> dict[str, object]:
    return {
        "weights": coupling.weights.tolist(),
        "interpolation": coupling.table.interpolation,
        "points": coupling.table.points,
        "neighbour": coupling.neighbour,
        "centre": coupling.centre,
        "times_argument": coupling.times_argument,
        "reversed_sign": coupling.reversed_sign,
        "to": coupling.to,
        "source": coupling.source,
        "centre_source": coupling.centre_source,
    }


def _facts(template: "Template") -> list[tuple[str, str]]:
    check = template.check
    given = ", ".join(f"{key} = {value}" for key, value in check.parameters) if check else ""
    boundary = f"{template.boundary} (state), {template.input_boundary} (input)"
    settles = template.duration == "settle"
    return [
        ("template", template.name),
        ("", " ".join(template.description.split())),
        ("source", template.source or "not given"),
        ("z", ", ".join(number(z, 6) for z in template.z.tolist())),
        ("τ", ", ".join(number(t, 6) for t in template.tau.tolist())),
        ("boundary", boundary),
        ("initial state", str(template.initial)),
        ("duration", "until it settles" if settles else template.timed(float(template.duration))),
        ("output", template.output.name),
        ("check", f"{check.name}{f' ({given})' if given else ''}" if check else "none"),
    ]


def _matrix(rows: list[list[float]]) -> str:
    cells = [[number(value, 6) for value in row] for row in rows]
    width = max(len(cell) for row in cells for cell in row)
    return "\n".join("    " + "  ".join(cell.rjust(width) for cell in row) for row in cells)


@click.command("gallery")
@click.argument("names", nargs=-1, metavar="[NAMES]...", shell_complete=completed("template"))
@file_option("gallery.html", "The page's file.")
@click.option("--engine", default="numba", show_default=True, help="Engine to run on.")
@click.option(
    "--live",
    is_flag=True,
    help="Let them run in the page, as WebAssembly made by Zig (extra 'embedded').",
)
@force_option
@json_option
def gallery(
    names: tuple[str, ...], out: Path, engine: str, live: bool, force: bool, as_json: bool
) -> None:
    """Write one searchable page of templates with pictures, numbers and checks.

    NAMES are templates, files or folders; by default the whole library. The page needs no other
    file and no network.
    """
    from cnnum.engine import Engine
    from cnnum.report.gallery import Card, filmstrip, gallery_page
    from cnnum.report.web_assembly import live_module
    from cnnum.safety.files import write_whole
    from cnnum.templating.checks import run_check
    from cnnum.templating.files import load_entry

    used, files, cards = Engine(engine), chosen(names), list[Card]()
    check = partial(run_check, engine=used, repeats=1)
    with progress("templates", len(files), as_json=as_json) as steps:
        for path in files:
            entry = load_entry(path)
            result = check(entry.template, measured=entry.measured)
            strip = filmstrip(entry.template, used)
            module = live_module(entry.template) if live else None
            cards.append(Card(entry, path.parent.name, strip, result, module))
            steps.advance(entry.template.name)
    write_whole(out, gallery_page(cards), force=force)
    running = sum(card.live is not None for card in cards)
    done = {"templates": len(cards), "live": running, "file": str(out)}
    words = f", {running} of which run in the page" if live else ""
    Output(as_json).record(done, f"{len(cards)} templates{words}: {out}")
