"""Writing a template file, with the errors of this room."""

from pathlib import Path

from cnnum.errors import TemplateError, TemplateFileError
from cnnum.safety.files import write_whole


def write_text(target: Path, text: str) -> None:
    """Replace `target` by `text` in one step: a reader sees the old file or the new one.

    Raises
    ------
    TemplateFileError
        If the file cannot be written.
    TemplateError
        If the text has no UTF-8 form.
    """
    try:
        content = text.encode("utf-8")
    except UnicodeEncodeError as error:
        raise TemplateError(
            f"'{target}' cannot be written as UTF-8 text: {error.reason}; "
            "remove that character from the name, the description or the source."
        ) from None
    try:
        write_whole(target, content)
    except ValueError as error:  # a name with a zero byte, or that the file system cannot hold
        raise TemplateFileError(
            f"No file can have the name {str(target)!r:.60}: {error}."
        ) from None
    except OSError as error:
        raise TemplateFileError(
            f"The template file '{target}' cannot be written: {error.strerror}; "
            "check that its folder exists and may be written to."
        ) from None
