"""The words of a `.tem` file with their lines, and its comments on start and rim."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from cnnum.errors import TemplateError

KEYWORDS = frozenset(
    [
        *("NRLAYERS", "LAYER", "NEIGHBORHOOD", "CURRENT", "DELAY", "FROM", "NONLIN_D"),
        *("FEEDBACK", "CONTROL", "NONLIN_FEEDBACK", "NONLIN_CONTROL"),
        *("DELAYED_FEEDBACK", "DELAYED_CONTROL", "LABEL", "TEMPLATE", "NEW", "LOOP"),
    ]
)
_SETTING = re.compile(r"(Input|IniState|Boundary|BiasMap)\s*:\s*([^,]*)", re.IGNORECASE)
_HEADER = re.compile(r"%\s*(Function|TemLibName|CNNModel|Setting)\s*:\s*(.*)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Token:
    """A word and its line, from 1."""

    text: str
    line: int

    @property
    def keyword(self) -> str:
        """The keyword that it is, in capitals, or ""."""
        word = self.text.upper()
        return word if word in KEYWORDS else ""


@dataclass(slots=True)
class Words:
    """The words of a file, read one after the other.

    Attributes
    ----------
    file : str
        For error messages.
    tokens : list of Token
    header : dict
        Values in the comments, by lower-case key: function, temlibname, cnnmodel, and of the
        setting input, inistate, boundary, biasmap.
    """

    file: str
    tokens: list[Token]
    header: dict[str, str] = field(default_factory=dict[str, str])
    at: int = 0

    @property
    def left(self) -> bool:
        """Whether there are words left."""
        return self.at < len(self.tokens)

    def peek(self) -> Token:
        """Return the next word, an empty one at the end."""
        last = self.tokens[-1].line if self.tokens else 1
        return self.tokens[self.at] if self.left else Token("", last)

    def take(self, expected: str) -> Token:
        """Return the next word and go on.

        Raises
        ------
        TemplateError
            If there is none; names the expected one.
        """
        token = self.peek()
        if not self.left:
            raise self.wrong(token.line, expected, "the end of the file")
        self.at += 1
        return token

    def number(self, expected: str) -> float:
        """Return the next word as a number.

        Raises
        ------
        TemplateError
            If it is none.
        """
        token = self.take(expected)
        try:
            value = float(token.text)
        except ValueError:
            raise self.wrong(token.line, expected, f"'{token.text:.40}'") from None
        if not abs(value) < 1e30:
            raise self.wrong(token.line, expected, f"'{token.text:.40}'")
        return value

    def whole(self, expected: str, most: int) -> int:
        """Return the next word as a whole number from 0 up to `most`.

        Raises
        ------
        TemplateError
            If it is none.
        """
        line, value = self.peek().line, self.number(expected)
        if value != int(value) or not 0 <= value <= most:
            raise self.wrong(line, f"{expected}, a whole number from 0 to {most}", f"{value:g}")
        return int(value)

    def wrong(self, line: int, expected: str, got: str) -> TemplateError:
        """Return the error that something else stands in a line."""
        return TemplateError(f"'{self.file}', line {line}: expected {expected}, got {got}.")


def words(content: str, file: str) -> Words:
    """Return the words of a file without its comments, whose settings are kept."""
    header = dict[str, str]()
    tokens = list[Token]()
    for number, line in enumerate(content.replace("\x1a", "").splitlines(), 1):
        code, sign, comment = line.partition("%")
        if sign:
            header |= _settings(sign + comment)
        if code.strip().lower().startswith("comment"):
            continue
        tokens += _of_line(code, number)
    return Words(file, tokens, header)


def _of_line(code: str, number: int) -> Iterator[Token]:
    found = [Token(word, number) for word in code.replace(":", " ").split()]
    # the number of a layer may be followed by its name in words
    keep = 2 if found and found[0].keyword == "LAYER" else len(found)
    yield from found[:keep]


def _settings(comment: str) -> dict[str, str]:
    match = _HEADER.match(comment)
    if match is None:
        return {key.lower(): value.strip() for key, value in _SETTING.findall(comment)}
    key, value = match[1].lower(), match[2].strip()
    if key != "setting":
        return {key: value}
    return {name.lower(): text.strip() for name, text in _SETTING.findall(value)}
