"""A template as TOML text; reading it back gives the same template."""

import json

from cnnum.arrays import Floats
from cnnum.errors import TemplateError
from cnnum.template import Check
from cnnum.template_files.entry import Entry


def entry_to_toml(entry: Entry) -> str:
    """Return the TOML text of a template and its aliases; every part is written out."""
    template = entry.template
    parts: dict[str, str] = {
        "name": _text(template.name),
        "aliases": f"[{', '.join(_text(alias) for alias in entry.aliases)}]",
        "description": _text(template.description),
        "source": _text(template.source),
        "A": _matrix(template.A),
        "z": _numbers(template.z),
        "tau": _numbers(template.tau),
        "boundary": _value(template.boundary.name),
        "input_boundary": _value(template.input_boundary.name),
        "initial": _value(template.initial),
        "duration": _value(template.duration),
        "output": _text(template.output.name),
    }
    if template.inputs:
        parts["B"] = _matrix(template.B)
    lines = [f"{key} = {value}" for key, value in parts.items()]
    return "\n".join([*lines, *_check(template.check), ""])


def _check(check: Check | None) -> list[str]:
    if check is None:
        return []
    names = [name for name, _ in check.parameters]
    if "name" in names or len(set(names)) < len(names):
        raise TemplateError(
            f"The check '{check.name}' must have parameters of different names, none of them "
            f"'name', got {names}."
        )
    lines = [f"{_text(name)} = {_value(value)}" for name, value in check.parameters]
    return ["", "[check]", f"name = {_text(check.name)}", *lines]


def _value(value: float | str) -> str:
    return _text(value) if isinstance(value, str) else repr(float(value))


def _text(value: str) -> str:
    # JSON and TOML escape alike but for DEL, and \u of a surrogate, which TOML does not know.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _numbers(values: Floats) -> str:
    return f"[{', '.join(repr(float(value)) for value in values)}]"


def _matrix(kernel: Floats) -> str:
    if kernel.shape[:2] == (1, 1):
        return _rows(kernel[0, 0], "")
    blocks = [", ".join(_rows(block, "  ") for block in row) for row in kernel]
    return "[\n  " + ",\n  ".join(f"[{block}]" for block in blocks) + ",\n]"


def _rows(block: Floats, indent: str) -> str:
    rows = "".join(f"{indent}  {_numbers(row)},\n" for row in block)
    return f"[\n{rows}{indent}]"
