"""Template files that a command is pointed at, and `cnnum templates import` and `export`."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from cnnum.cli.options import completed, force_option, json_option
from cnnum.cli.output import Output

if TYPE_CHECKING:
    from cnnum.templating.files import Entry


def is_place(name: str) -> bool:
    """Return whether a name is a file's or a folder's, and none of the library."""
    return "/" in name or Path(name).suffix != "" or Path(name).is_dir()


def chosen(names: tuple[str, ...]) -> list[Path]:
    """Return the files of templates by name, file or folder; the whole library's for none.

    Raises
    ------
    UnknownNameError
        If the library has no such template.
    TemplateFileError
        If a folder holds no template.
    """
    from cnnum.templating.library import template_names, template_path

    files = list[Path]()
    for name in names or template_names():
        files += _under(Path(name)) if is_place(name) else [template_path(name)]
    return files


def _under(place: Path) -> list[Path]:
    from cnnum.errors import TemplateFileError

    if not place.is_dir():
        return [place]
    result = sorted(place.rglob("*.toml"))
    if not result:
        raise TemplateFileError(f"The folder '{place}' holds no template: expected .toml files.")
    return result


@click.command("import")
@click.argument("files", nargs=-1, required=True, metavar="FILES...")
@click.option("--to", "folder", default=".", help="Folder for the new files.")
@click.option("--strict", is_flag=True, help="Refuse files in which something has to be guessed.")
@force_option
@json_option
def import_files(
    files: tuple[str, ...], folder: str, strict: bool, force: bool, as_json: bool
) -> None:
    """Write templates of other programs as TOML, one file each.

    FILES are `.tem` files of the CNN Software Library, MatCNN's temlib.m, or CNNSim's files. The
    command prints each guess about a file, and what its format cannot express.
    """
    from cnnum.errors import TemplateFileError
    from cnnum.safety.files import make_folder, named_after, refuse_target, sentences
    from cnnum.templating.files import guessed, load_entries, save_entry

    output, target, sources = Output(as_json), Path(folder), dict[Path, tuple[str, "Entry"]]()
    for file in files:
        entries = load_entries(file)
        guessed(entries, strict=strict)
        for entry in entries:
            name = entry.template.name
            path = named_after(target, name, ".toml")
            if path in sources:
                other, first = sources[path]
                raise TemplateFileError(
                    f"'{file}' and '{other}' both contain a template '{name}', and each template "
                    "becomes a file of its name: import them into two folders."
                    if first.template.name == name
                    else f"The templates '{first.template.name}' of '{other}' and '{name}' of "
                    f"'{file}' would both become the file '{path.name}': import them into two "
                    "folders."
                )
            sources[path] = file, entry
    said, never = dict[str, None](), dict[str, None]()
    with sentences(target, TemplateFileError):
        make_folder(target)
    for path in sources:  # all are looked at before one is written
        refuse_target(path, error=TemplateFileError, force=force)
    for path, (file, entry) in sources.items():
        save_entry(entry, path, force=force)
        name = entry.template.name
        guesses = guessed((entry,))
        output.record(
            {"template": name, "from": file, "file": str(path), "guesses": list(guesses)},
            f"{name}: {path}",
        )
        said.update(dict.fromkeys(guesses))
        never.update(dict.fromkeys(g.sentence for g in entry.guesses if g.always))
    for sentence in said:
        output.show(f"Guessed: {sentence}")
    for sentence in never:
        output.show(sentence)


@click.command("export")
@click.argument("name", shell_complete=completed("template", files=True))
@click.argument("file")
@click.option(
    "--for",
    "program",
    type=click.Choice(["matcnn", "celnn", "pycnn"]),
    help="Write a script that runs the template in that program.",
)
@force_option
@json_option
def export(name: str, file: str, program: str | None, force: bool, as_json: bool) -> None:
    """Write the template NAME (of the library, or a file) to FILE.

    The suffix selects the format: .tem (CNN Software Library), .m (MatCNN), .cnnsim or .toml. With
    --for, FILE is a script: in MATLAB for MatCNN, and in Python for celnn and PyCNN.
    """
    from cnnum.templating.files import left_unsaid, load_entry, save_entry
    from cnnum.templating.files.unsaid import WORDS
    from cnnum.templating.library import get_entry

    entry = load_entry(name) if is_place(name) else get_entry(name)
    if program is not None:
        _export_script(entry, file, program, force=force, output=Output(as_json))
        return
    save_entry(entry, file, force=force)
    lost, output = [key for key in left_unsaid(entry, file) if key not in WORDS], Output(as_json)
    output.record(
        {"template": entry.template.name, "file": file, "in_comments": lost},
        f"{entry.template.name}: {file}",
    )
    if lost:
        output.show(
            f"Other programs will not see its {', '.join(lost)}: the format cannot express "
            "this, so it is written as comments, which cnnum reads back."
        )


def _export_script(entry: "Entry", file: str, program: str, *, force: bool, output: Output) -> None:
    from cnnum.errors import TemplateFileError
    from cnnum.safety.files import write_whole
    from cnnum.templating.files.scripts import script

    suffix = ".m" if program == "matcnn" else ".py"
    if Path(file).suffix.lower() != suffix:
        raise click.UsageError(f"A script for {program} must be a '{suffix}' file, got '{file}'.")
    text = script(entry, program)
    write_whole(Path(file), text.encode("utf-8"), error=TemplateFileError, force=force)
    name = entry.template.name
    output.record({"template": name, "file": file, "program": program}, f"{name}: {file}")
    if program == "matcnn" and entry.template.duration == "settle":
        output.show(
            "MatCNN does not stop when the array has settled: the script runs it for 2 time "
            "constants per cell of the longer side; raise 'duration' where that is too short."
        )
