"""Figures of a template that a command measured, as the table [measured] of its file keeps them.

`cnnum templates measure` writes the table as the last one of the file; nothing else should.
"""

from dataclasses import dataclass

from cnnum.errors import TemplateError
from cnnum.templating.files.toml_values import number, points, table, text

KEYS = ("digest", "mean", "rms", "settle", "margin")


@dataclass(frozen=True, slots=True)
class Measured:
    """Figures of a template on the pictures of its own check.

    Attributes
    ----------
    digest : str
        Digest of all numbers that change a run, so that none changes unseen.
    mean, rms : float
        Of the states at the end of the check's run on 8×8 cells.
    settle : tuple of (cells along a side, time constants)
        When the outputs come within 0.01 of their end, on square arrays. It is empty where they
        never do within the longest run, or where the check stops before.
    margin : float or None
        The largest number that may be added to the bias, and taken from it, with no wrong cell.
        None where the answer is gray.
    """

    digest: str
    mean: float
    rms: float
    settle: tuple[tuple[int, float], ...] = ()
    margin: float | None = None


def read_measured(file: str, key: str, value: object) -> Measured:
    """Return the values of the table [measured].

    Raises
    ------
    TemplateError
        If a key is missing or unknown, or a value is wrong.
    """
    found = table(file, key, value)
    unknown = [name for name in found if name not in KEYS]
    missing = [name for name in KEYS[:3] if name not in found]
    if unknown or missing:
        raise TemplateError(
            f"'{file}': the table '{key}' has the keys {', '.join(KEYS)}, got "
            f"{', '.join(found) or 'none'}; measure the template again."
        )
    margin = found.get("margin")
    return Measured(
        text(file, f"{key}.digest", found["digest"]),
        number(file, f"{key}.mean", found["mean"]),
        number(file, f"{key}.rms", found["rms"]),
        _settle(file, f"{key}.settle", found.get("settle", [])),
        None if margin is None else number(file, f"{key}.margin", margin),
    )


def _settle(file: str, key: str, value: object) -> tuple[tuple[int, float], ...]:
    return tuple((int(cells), time) for cells, time in points(file, key, value))


def measured_toml(measured: Measured) -> str:
    """Return the table [measured] as TOML, without an empty line before it."""
    pairs = ", ".join(f"[{cells}, {time:.3g}]" for cells, time in measured.settle)
    lines = {
        "digest": f'"{measured.digest}"',
        "mean": f"{measured.mean:.6g}",
        "rms": f"{measured.rms:.6g}",
    }
    if measured.settle:
        lines["settle"] = f"[{pairs}]"
    if measured.margin is not None:
        lines["margin"] = f"{measured.margin:.3g}"
    return "[measured]\n" + "".join(f"{key} = {value}\n" for key, value in lines.items())
