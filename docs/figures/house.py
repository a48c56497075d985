"""The house as it is: rooms, floors and imports; `python docs/figures/house.py` draws it anew.

It writes `docs/house.svg` and the table in `docs/architecture.md`. A test holds both to the code.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE, PICTURE = ROOT / "docs" / "architecture.md", ROOT / "docs" / "house.svg"

# A room may import from rooms on its own floor or below, never from above.
FLOORS: list[dict[str, str]] = [
    {
        "errors": "all errors, each with a message of one sentence",
        "version": "the version of the package",
        "renamed": "old names that work for one more version",
    },
    {
        "arrays": "number types, and checks of the arrays that callers pass in",
        "values": "equality by content, and objects that belong to one process",
    },
    {"kernels": "kernels as records, and their printers: OpenCL C and C99"},
    {"safety": "checks of names, expressions and available memory; the writing of files"},
    {"sharing": "objects as datasets, tables, HTML and plots"},
    {"frame": "one scan of a tactile array", "pictures": "pixels and picture files"},
    {"templating": "templates, couplings, boundaries, outputs, template files, the library"},
    {
        "graph": "operations of a program, and their schedule",
        "tactile": "closed forms of covers, contacts and taxels",
    },
    {"integrators": "methods described as data, their bounds, and the choice of one"},
    {"embedded": "programs in integer arithmetic, their emulator, and C99"},
    {"engines": "opencl, numba and reference, and the devices of OpenCL"},
    {"programs": "the language of analogic programs"},
    {"plan": "a compiled program", "stream": "frames in time"},
    {"runs": "runs of single templates"},
    {"engine": "`cnnum.Engine`"},
    {"templating.checks": "checks of templates and programs against closed forms"},
    {"templates": "the template library and the tactile programs"},
    {"design": "templates from rules, examples and searches"},
    {"recordings": "recording files that survive crashes"},
    {"drivers": "arrays, recordings, and the simulated array"},
    {"scenes": "scene files, and the path of a frame to its events"},
    {"report": "the page of a scene, and its pictures", "live": "the live view in a browser"},
    {"cli": "the commands"},
    {"__init__": "the public names", "__main__": "`python -m cnnum`"},
    {"lab": "what verifies the results: benchmarks, scores, stability, the dissertation's figures"},
]
FLOOR = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}


def sources() -> Iterator[tuple[Path, Path]]:
    """Yield every module of the package, and its path in the checkout."""
    for folder in ("cnnum", "drivers", "templates"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            relative = path.relative_to(ROOT)
            if relative.parts[:2] not in {("cnnum", "drivers"), ("cnnum", "templates")}:
                yield path, relative


def room_of(parts: tuple[str, ...]) -> str:
    """Return the room of a module: the longest known one of its name below `cnnum`."""
    names = [".".join(parts[:length]) for length in range(len(parts), 0, -1)]
    return next((name for name in names if name in FLOOR), names[-1])


def own_room(relative: Path) -> str:
    """Return the room that a file is in."""
    parts = relative.with_suffix("").parts
    return room_of(parts if parts[0] in {"drivers", "templates"} else parts[1:])


def imports_of(path: Path) -> Iterator[str]:
    """Yield the modules that a file imports when it is loaded or run, not for type checkers."""
    tree = ast.parse(path.read_text())
    skipped = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if node in skipped:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def rooms_of(module: str) -> str | None:
    """Return the room of an imported module, None where it is none of ours."""
    parts = tuple(module.split("."))
    return room_of(parts[1:]) if parts[0] == "cnnum" and len(parts) > 1 else None


def arrows() -> dict[str, set[str]]:
    """Return for each room the others that it imports from."""
    found: dict[str, set[str]] = {room: set() for room in FLOOR}
    for path, relative in sources():
        room = own_room(relative)
        others = {other for module in imports_of(path) if (other := rooms_of(module))}
        found[room] |= others - {room}
    return found


def reduced(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """Return the arrows that no other way of arrows stands for."""

    def reach(room: str, seen: set[str]) -> set[str]:
        for other in graph[room] - seen:
            seen.add(other)
            reach(other, seen)
        return seen

    below = {room: reach(room, set()) for room in graph}
    return {
        room: {o for o in others if not any(o in below[other] for other in others - {o})}
        for room, others in graph.items()
    }


def table() -> str:
    """Return the rooms as a table, the highest floor first."""
    lines = ["| room | content |", "|---|---|"]
    for floor in reversed(FLOORS):
        lines += [f"| `{room}` | {purpose} |" for room, purpose in floor.items()]
    return "\n".join(lines)


# columns and rows of the picture, chosen so that no arrow crosses a box
PLACES = {
    "cli": (1, 0),
    "lab": (1, 1),
    "report": (2, 2),
    "scenes": (0, 3),
    "engine": (0, 4),
    "templates": (1, 4),
    "templating.checks": (2.15, 4),
    "drivers": (3, 4),
    "runs": (0, 5),
    "plan": (0, 6),
    "programs": (1.5, 6),
    "recordings": (3, 5),
    "stream": (0, 7),
    "tactile": (3, 7.2),
    "engines": (0, 8),
    "embedded": (1.5, 9),
    "integrators": (0.1, 10),
    "kernels": (1.3, 10.3),
    "frame": (3, 10.4),
    "graph": (0.4, 11.1),
    "templating": (1.9, 12.2),
    "sharing": (3, 13.2),
    "safety": (2.1, 13.2),
    "arrays": (2.1, 14.2),
    "errors": (1.3, 15.2),
}
COLUMN, ROW, BOX = 225, 68, (184, 38)
STYLE = """
  .room { fill: #fff; stroke: #456; } .name { font: 600 14px sans-serif; fill: #123; }
  .arrow { stroke: #789; stroke-width: 1.3; marker-end: url(#tip); } .tip { fill: #789; }
  @media (prefers-color-scheme: dark) { .room { fill: #1c2733; stroke: #9ab; }
  .name { fill: #e8eef4; } .arrow { stroke: #8aa0b4; } .tip { fill: #8aa0b4; } }
"""


def _centre(room: str) -> tuple[float, float]:
    column, row = PLACES[room]
    return (column + 0.5) * COLUMN, (row + 0.5) * ROW


def picture() -> str:
    """Return the house as SVG: a box a room, an arrow an import that no other way stands for."""
    width, height = BOX
    graph = {
        room: {other for other in others if other in PLACES}
        for room, others in arrows().items()
        if room in PLACES
    }
    columns, rows = (1 + int(max(place[axis] for place in PLACES.values())) for axis in (0, 1))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {columns * COLUMN} {rows * ROW}" '
        'role="img" aria-label="The rooms of the house and their imports">',
        f"<style>{STYLE}</style>",
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" '
        'markerHeight="8" orient="auto"><path class="tip" d="M0 0L8 4L0 8z"/></marker></defs>',
    ]
    for room, others in sorted(reduced(graph).items()):
        for other in sorted(others):
            (x, y), (u, v) = _centre(room), _centre(other)
            aside = max(-0.4, min(0.4, (u - x) / (4 * COLUMN))) * width
            parts.append(
                f'<line class="arrow" x1="{x + aside:.0f}" y1="{y + height / 2:.0f}" '
                f'x2="{u - aside:.0f}" y2="{v - height / 2:.0f}"><title>{room} imports from '
                f"{other}</title></line>"
            )
    for room in PLACES:
        (x, y), purpose = _centre(room), next(floor[room] for floor in FLOORS if room in floor)
        parts.append(
            f'<g><title>{room}: {purpose}</title><rect class="room" x="{x - width / 2:.0f}" '
            f'y="{y - height / 2:.0f}" width="{width}" height="{height}" rx="6"/>'
            f'<text class="name" x="{x:.0f}" y="{y + 5:.0f}" text-anchor="middle">{room}</text></g>'
        )
    return "\n".join([*parts, "</svg>", ""])


def page(text: str) -> str:
    """Return the page with the table as it is now."""
    head, _, rest = text.partition("<!-- rooms -->\n")
    _, _, tail = rest.partition("<!-- end of rooms -->")
    return f"{head}<!-- rooms -->\n{table()}\n<!-- end of rooms -->{tail}"


if __name__ == "__main__":
    PICTURE.write_text(picture())
    PAGE.write_text(page(PAGE.read_text()))
