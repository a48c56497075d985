"""Plain English in code and docs: a few words that take two readings stay out."""

import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOMS = ("cnnum", "drivers", "templates", "docs")

BANNED = re.compile(r"\b(besides?|so many|so much|tells?|told|nobody|can not)\b", re.IGNORECASE)

ALLOWED = {
    "cnnum/live/hub.py": {"told"},  # a parameter, and a key that pages read
    "cnnum/lab/stability/cases/extreme.py": {"beside"},  # in a case's name, which users select by
}
"""Words by file that are identifiers within prose."""

MOST_WHAT = 80
"""Times that "what" may stand in prose of the code: questions, and pronouns that need it."""


def files(*endings: str) -> Iterator[Path]:
    """The files of the rooms, without those behind links, and the README."""
    yield from (ROOT / name for name in ("README.md",) if name.endswith(endings))
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*")):
            links = any(parent.is_symlink() for parent in path.parents)
            if path.suffix in endings and not links and "_build" not in path.parts:
                yield path


def prose(path: Path) -> Iterator[tuple[int, str]]:
    """Lines with their numbers: of Python, comments and strings; of other files, all."""
    text = path.read_text()
    if not re.search(
        rf"{BANNED.pattern}|\bwhat\b|\bso$|\bcan$", text, re.IGNORECASE | re.MULTILINE
    ):
        return  # most files: they need no tokens
    if path.suffix != ".py":
        yield from enumerate(text.splitlines(), 1)
        return
    names = {"STRING", "COMMENT", "FSTRING_MIDDLE"}
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if tokenize.tok_name[token.type] in names:
            yield from enumerate(token.string.splitlines(), token.start[0])


def joined(path: Path) -> Iterator[tuple[int, str]]:
    """Lines of prose with the first word of the next one: "so" may end a line."""
    lines = list(prose(path))
    for (number, line), (_, after) in zip(lines, [*lines, (0, "")][1:], strict=True):
        yield number, f"{line.rstrip()} {' '.join(after.split()[:1])}"


def found(path: Path) -> Iterator[str]:
    """Sentences on the banned words of a file."""
    relative = path.relative_to(ROOT).as_posix()
    for number, line in joined(path):
        own = line.rsplit(" ", 1)[0]
        for match in BANNED.finditer(line):
            begins_here = match.start() < len(own)
            if begins_here and match[0].lower() not in ALLOWED.get(relative, ()):
                yield f"{relative}:{number} has '{match[0]}'"


def test_words_that_take_two_readings_stay_out():
    assert not [line for path in files(".py", ".md", ".toml") for line in found(path)]


def test_the_noun_stands_in_place_of_what():
    code = [path for path in files(".py", ".toml") if "docs" not in path.parts]
    whats = sum(
        len(re.findall(r"\bwhat\b", line, re.IGNORECASE))
        for path in code
        for _, line in prose(path)
    )
    assert whats <= MOST_WHAT, f"'what' stands {whats} times in the prose of the code"


def test_these_tests_see_the_words(tmp_path):
    sample = tmp_path / "sample.py"
    sample.write_text('"""So\nmany."""\ntold = 1  # can not\n')
    seen = [match[0].split()[0] for _, line in joined(sample) for match in BANNED.finditer(line)]
    assert seen == ["So", "can"]
