"""Template files that a command is pointed at, by name, file or folder."""

from pathlib import Path


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
    found = sorted(place.rglob("*.toml"))
    if not found:
        raise TemplateFileError(f"The folder '{place}' holds no template: expected .toml files.")
    return found
