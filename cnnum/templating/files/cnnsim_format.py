"""CNNSim's files: keys A and B with nine numbers each, Z with one, C with the boundary."""

from cnnum.arrays import Floats
from cnnum.errors import NotSupportedError
from cnnum.templating.boundary import Boundary
from cnnum.templating.files.entry import Entry, FileFormat, Guess
from cnnum.templating.files.tem_format import Words, words
from cnnum.templating.template import Template

_NEUTRAL: float | str = 0.0
"""The boundary of a file that names none."""

_BOUNDARIES = {"zeroflux": "zero-flux", "periodic": "periodic"}


_KEYS = {"A": "A", "B": "B", "Z": "z", "C": "boundary"}
_ALWAYS = (
    Guess("initial", "A CNNSim file names no initial state: it is 0.", always=True),
    Guess("duration", "A CNNSim file names no duration: it runs until it settles.", always=True),
)


def _read(content: str, file: str) -> Entry:
    text = words(content.replace("#", "%"), file)
    kernels = dict[str, list[list[float]]]()
    z, edge, said = 0.0, _NEUTRAL, set[str]()
    while text.left:
        token = text.take("a key")
        key = token.text.rstrip("=").upper()
        key = "C" if key == "BOUNDARY" else key
        if key in said:
            text.guess(
                _KEYS[key], token.line, f"the key {key} stands twice, and the last one counts"
            )
        said.add(key)
        if key in ("A", "B"):
            kernels[key] = [[text.number(f"nine numbers of {key}") for _ in "123"] for _ in "123"]
        elif key == "Z":
            z = text.number("the bias after Z")
        elif key == "C":
            edge = _boundary(text)
        else:
            raise text.wrong(token.line, "one of the keys A, B, Z, C", f"'{token.text:.40}'")
    if "A" not in kernels:
        raise text.wrong(text.peek().line, "the key A with nine numbers", "none")
    if "C" not in said:
        text.guess("boundary", 0, "no boundary (C) is named: 0 is taken")
    name = file.replace("\\", "/").rpartition("/")[2].partition(".")[0]
    return Entry(
        Template(
            name or "template",
            kernels["A"],
            kernels.get("B"),
            z,
            boundary=edge,
            initial=0.0,
            source=f"imported from CNNSim's {name}",
        ),
        guesses=(*text.guesses, *_ALWAYS),
    )


def _boundary(text: Words) -> float | str:
    token = text.take("Constant, ZeroFlux or Periodic")
    kind = token.text.lower()
    if kind == "constant":
        return text.number("the constant of the boundary")
    if kind not in _BOUNDARIES:
        raise text.wrong(token.line, "Constant, ZeroFlux or Periodic", f"'{token.text:.40}'")
    return _BOUNDARIES[kind]


def _write(entry: Entry) -> str:
    template = entry.template
    plain = template.plain and template.layers == 1 and template.inputs <= 1
    if not plain or template.radius > 1 or template.output.name != "standard":
        raise NotSupportedError(
            f"Template '{template.name}' cannot be written as a CNNSim file, which holds only "
            "A, B and z of radius 1 with the standard output: save it as .toml."
        )
    lines = ["A", *_rows(template.A[0, 0])]
    lines += ["B", *_rows(template.B[0, 0])] if template.inputs else []
    edge = _said(template.boundary)
    return "\n".join([*lines, f"Z {float(template.z[0])!r}", f"C {edge}", ""])


def _rows(kernel: Floats) -> list[str]:
    if len(kernel) == 1:
        return ["0.0 0.0 0.0", f"0.0 {float(kernel[0, 0])!r} 0.0", "0.0 0.0 0.0"]
    return [" ".join(repr(v) for v in row) for row in kernel.tolist()]


def _said(boundary: Boundary) -> str:
    if boundary.constant is not None:
        return f"Constant {boundary.constant!r}"
    return "ZeroFlux" if boundary.pad_mode == "symmetric" else "Periodic"


CNNSIM = FileFormat(".cnnsim", _read, _write)
"""A template as CNNSim writes it; such files have no suffix there."""
