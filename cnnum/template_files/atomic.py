"""Writing a text file whole or not at all."""

import os
import tempfile
from pathlib import Path

from cnnum.errors import TemplateError, TemplateFileError


def write_whole(target: Path, text: str) -> None:
    """Replace `target` by `text` in one step: a reader sees the old file or the new one.

    Raises
    ------
    TemplateFileError
        If the file can not be written.
    TemplateError
        If the text has no UTF-8 form.
    """
    try:
        content = text.encode("utf-8")
    except UnicodeEncodeError as error:
        raise TemplateError(
            f"'{target}' can not be written as UTF-8 text: {error.reason}; "
            "remove that character from the name, the description or the source."
        ) from None
    try:
        _replace(target, content)
    except OSError as error:
        raise TemplateFileError(
            f"The template file '{target}' can not be written: {error.strerror}; "
            "check that its folder exists and may be written to."
        ) from None


def _replace(target: Path, content: bytes) -> None:
    # In the same folder, because a rename is atomic only within one file system.
    handle, name = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
    draft = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        draft.chmod(0o644)
        draft.replace(target)
    except OSError:
        draft.unlink(missing_ok=True)
        raise
