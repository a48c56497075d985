"""Flow diagrams of slip and twist, made from their graphs; `python -m docs.figures.program_flow`.

It writes `docs/programs/slip-flow.svg` and `twist-flow.svg`. A box stands for the operations that
give the values it names, and lists the templates and sums among them. An arrow says that a box
reads another one, through nothing but local operations. A test holds the pictures to the programs.
"""

import inspect
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from cnnum.frame import FORCE_AXES
from cnnum.graph.nodes import Graph, Input, Node, Read, Reduce, Transient
from cnnum.graph.schedule import has_feedback
from cnnum.programs import Program
from cnnum.programs.fields import Field
from cnnum.programs.machine import NOMINAL, FrameFields
from cnnum.templates.tactile import slip as slip_file
from cnnum.templates.tactile.shared.loads import RecentLoads
from cnnum.templates.tactile.twist import twist

FOLDER = Path(__file__).parents[1] / "programs"

CELL, BOX = (168, 84), (152, 46)
"""Pixels from box to box, and of a box."""

STYLE = """
  .box { fill: #fff; stroke: #456; } .name { font: 600 12px sans-serif; fill: #123; }
  .made { font: 10px sans-serif; fill: #456; } .group { fill: #eef3f8; }
  .title { font: 600 12px sans-serif; fill: #678; }
  .arrow { stroke: #789; stroke-width: 1.2; fill: none; marker-end: url(#tip); }
  .tip { fill: #789; }
  @media (prefers-color-scheme: dark) { .box { fill: #1c2733; stroke: #9ab; }
  .name { fill: #e8eef4; } .made { fill: #a9bccd; } .group { fill: #131c25; }
  .title { fill: #8aa0b4; } .arrow { stroke: #8aa0b4; } .tip { fill: #8aa0b4; } }
"""


@dataclass(frozen=True, slots=True)
class Box:
    """Values of a program under one name, and where they are drawn: column, row, group."""

    name: str
    nodes: tuple[Node, ...]
    place: tuple[float, int]
    group: str = ""


@dataclass(frozen=True, slots=True)
class Traced:
    """A program's graph, its outputs, and the maps and sums that it starts from."""

    graph: Graph
    outputs: dict[str, Field]
    recent: RecentLoads

    @classmethod
    def of(cls, program: Program) -> "Traced":
        """Trace a program with its own constants, on 8×8 taxels."""
        graph = Graph((8, 8))
        frame, takes = (
            FrameFields(graph, FORCE_AXES, NOMINAL),
            inspect.signature(RecentLoads).parameters,
        )
        outputs = dict(program(frame))
        graph.outputs.update({name: field.node for name, field in outputs.items()})
        own = inspect.signature(program.function).parameters
        settings = {name: own[name].default for name in takes if name in own and name != "frame"}
        return cls(graph, outputs, frame.once(RecentLoads, **settings))

    def channels(self, *names: str) -> list[Node]:
        """Return the nodes of channels."""
        return [n for n in self.graph.nodes if n.operation in [Input(name) for name in names]]

    def memory(self, name: str) -> list[Node]:
        """Return a memory's value by name, and its next value."""
        reads = [(memory.read.operation, memory) for memory in self.graph.memories.values()]
        found = [m for read, m in reads if isinstance(read, Read) and read.name == name]
        return [node for memory in found for node in (memory.read, memory.store)]

    def held(self, fields: Iterable[Field]) -> list[Node]:
        """Return the maps of memories, and their next maps."""
        reads = [field.node for field in fields]
        stores = {m.read: m.store for m in self.graph.memories.values()}
        return [*reads, *(stores[read] for read in reads)]

    def run_by(self, *templates: str) -> list[Node]:
        """Return the results of transients of these templates."""
        return [
            node
            for node in self.graph.nodes
            for source in node.arguments[:1]
            if isinstance(source.operation, Transient)
            and source.operation.template.name in templates
        ]

    def unmasked(self, name: str) -> list[Node]:
        """Return an output before it is set to 0 during the rest."""
        return [self.outputs[name].node.arguments[-1]]


def nodes_of(fields: Iterable[Field]) -> list[Node]:
    """Return the nodes behind fields."""
    return [field.node for field in fields]


Drawn = tuple[str, list[Node], tuple[float, int], str]


def start_of(traced: Traced) -> list[Drawn]:
    """Return the boxes that both programs begin with."""
    recent, (pad,) = traced.recent, traced.recent.pads
    loads = nodes_of([pad.load, pad.before, pad.power, pad.even, recent.load])
    return [
        ("normal", traced.channels("normal"), (1, 0), ""),
        ("shear x, shear y", traced.channels("shear_x", "shear_y"), (4, 0), ""),
        ("load now", nodes_of([recent.z]), (1, 1), "templates"),
        ("shear now", nodes_of(recent.shear), (4, 1), "templates"),
        ("load a moment ago", traced.held([recent.old_z]), (1, 2), "templates"),
        ("noise at rest", nodes_of([recent.noise]), (0, 3), "read-outs"),
        ("load, least load", loads, (1, 3), "read-outs"),
        ("ratio", nodes_of([pad.ratio]), (2, 3), "read-outs"),
    ]


def slip_flow() -> tuple[Traced, list[Drawn]]:
    """Return the boxes of `slip`."""
    traced = Traced.of(slip_file.slip)
    recent, (pad,) = traced.recent, traced.recent.pads
    load = inspect.signature(slip_file.slip.function).parameters["load"].default
    (made,) = recent.frame.once(slip_file.read_outs, recent=recent, load=load)
    signs = {name: [field.node] for name, field in made.items()}
    changes = [node for name in ("load_rate", "swings", "trend") for node in signs[name]]
    changes += traced.memory("trend")
    return traced, [
        *start_of(traced),
        ("shear a moment ago", traced.held(recent.old_shear), (4, 2), "templates"),
        ("slip_x, slip_y", nodes_of(pad.pull), (3, 3), "read-outs"),
        ("ratio rate", signs["ratio_rate"], (4, 3), "read-outs"),
        ("largest load", nodes_of([recent.z.max()]), (5, 3), "read-outs"),
        ("slopes of the load", traced.run_by("gradient_x", "gradient_y"), (1, 4), "templates"),
        ("local mean of its change", traced.run_by("tactile_diffusion"), (4, 4), "templates"),
        ("cells come loose", traced.memory("loose"), (5, 4), "templates"),
        ("load rate, swings, trend", changes, (0, 5), "read-outs"),
        ("pattern speed", signs["pattern_speed"], (1, 5), "read-outs"),
        ("along the shear", signs["motion_cosine"], (2, 5), "read-outs"),
        ("aligned with the load", signs["alignment"], (3, 5), "read-outs"),
        ("incoherent shear", signs["incoherent_shear"], (4, 5), "read-outs"),
        ("stick share", signs["stick_share"], (5, 5), "read-outs"),
        ("torque in use", signs["torque"], (0, 4), "read-outs"),
        ("slip_strength", traced.unmasked("slip_strength"), (2, 6), "decision"),
        ("slip_turning", traced.unmasked("slip_turning"), (0, 6), "decision"),
        ("slip_pivots", nodes_of([traced.outputs["slip_pivots"]]), (1, 6), "decision"),
        ("gross_slip", nodes_of([traced.outputs["gross_slip"]]), (3, 6), "decision"),
    ]


def twist_flow() -> tuple[Traced, list[Drawn]]:
    """Return the boxes of `twist`."""
    traced = Traced.of(twist)
    place = [*traced.unmasked("twist_row"), *traced.unmasked("twist_column")]
    (strength,) = traced.unmasked("twist_strength")
    (turned,) = strength.arguments
    before = traced.memory("divergence at last change")
    return traced, [
        *start_of(traced),
        ("curl of the shear", traced.run_by("shear_curl"), (4, 2), "templates"),
        ("twist_row, twist_column", place, (0, 4), "read-outs"),
        ("jolt", nodes_of([traced.recent.load_rate]), (1, 4), "read-outs"),
        ("divergence of the shear", traced.run_by("shear_divergence"), (5, 2), "templates"),
        ("curl over load", [turned.arguments[0]], (4, 3), "read-outs"),
        ("divergence over load", [before[1].arguments[1]], (5, 3), "read-outs"),
        ("curl at the last jolt", traced.memory("curl at last change"), (4, 4), "read-outs"),
        ("divergence at that jolt", before, (5, 4), "read-outs"),
        ("a load is hidden", traced.memory("load is hidden"), (2, 4), "read-outs"),
        ("twist_strength", [strength, turned], (3, 5), "decision"),
        ("twist", nodes_of([traced.outputs["twist"]]), (4, 5), "decision"),
        ("twist_sense", nodes_of([traced.outputs["twist_sense"]]), (5, 5), "decision"),
    ]


def behind(traced: Traced, box: Box, others: Iterable[Box]) -> tuple[list[Box], str]:
    """Return the boxes that a box reads, and the operations between them and it."""
    owner = {node: other for other in others if other is not box for node in other.nodes}
    stores = {memory.read: memory.store for memory in traced.graph.memories.values()}
    read: dict[str, Box] = {}
    runs: Counter[str] = Counter()
    waiting, seen = list(box.nodes), set(box.nodes)
    while waiting:
        node = waiting.pop()
        if isinstance(node.operation, Transient):
            template = node.operation.template
            runs[template.name + (" (feedback)" if has_feedback(template) else "")] += 1
        elif isinstance(node.operation, Reduce):
            runs[node.operation.function.name] += 1
        held = [stores[node]] if isinstance(node.operation, Read) and node in stores else []
        for source in (*node.arguments, *held):
            if source in owner:
                read[owner[source].name] = owner[source]
            elif source not in seen:
                seen.add(source)
                waiting.append(source)
    made = ", ".join(f"{count} × {name}" for name, count in sorted(runs.items()))
    return list(read.values()), made


def _centre(box: Box) -> tuple[float, float]:
    return (box.place[0] + 0.5) * CELL[0] + 4.0, (box.place[1] + 0.5) * CELL[1] + 4.0


def _bands(boxes: list[Box], width: float) -> Iterator[str]:
    """Yield the background of consecutive rows of the same group."""
    groups = {box.place[1]: box.group for box in boxes if box.group}
    for group, some in groupby(sorted(groups), key=lambda row: groups[row]):
        rows = list(some)
        top, bottom = rows[0] * CELL[1] + 7.0, (rows[-1] + 1) * CELL[1] + 1.0
        yield (
            f'<rect class="group" x="2" y="{top:.0f}" width="{width - 4:.0f}" '
            f'height="{bottom - top:.0f}" rx="8"/><text class="title" x="{width - 10:.0f}" '
            f'y="{top + 16:.0f}" text-anchor="end">{group}</text>'
        )


def _arrow(source: Box, to: Box) -> str:
    (x, y), (u, v) = _centre(source), _centre(to)
    y, v = (y + BOX[1] / 2, v - BOX[1] / 2) if v > y else (y, v)
    if v == y:  # side by side
        x, u = (x + BOX[0] / 2, u - BOX[0] / 2) if u > x else (x - BOX[0] / 2, u + BOX[0] / 2)
        way = f"M{x:.0f} {y:.0f}L{u:.0f} {v:.0f}"
    else:
        lean = max(-0.4, min(0.4, (u - x) / 700)) * BOX[0]
        x, u, bend = x + lean, u - lean, 0.45 * (v - y)
        way = f"M{x:.0f} {y:.0f}C{x:.0f} {y + bend:.0f} {u:.0f} {v - bend:.0f} {u:.0f} {v:.0f}"
    return f'<path class="arrow" d="{way}"><title>{to.name} reads {source.name}</title></path>'


def picture(name: str, traced: Traced, drawn: list[Drawn]) -> str:
    """Return a program's flow as SVG."""
    boxes = [Box(title, tuple(nodes), place, group) for title, nodes, place, group in drawn]
    width = (max(box.place[0] for box in boxes) + 1.0) * CELL[0] + 76.0
    height = (max(box.place[1] for box in boxes) + 1.0) * CELL[1] + 8.0
    found = {box.name: behind(traced, box, boxes) for box in boxes}
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'role="img" aria-label="The flow of {name}: templates, read-outs, decision">',
        f"<style>{STYLE}</style>",
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto"><path class="tip" d="M0 0L8 4L0 8z"/></marker></defs>',
        *_bands(boxes, width),
        *(_arrow(source, box) for box in boxes for source in found[box.name][0]),
    ]
    for box in boxes:
        (x, y), made = _centre(box), found[box.name][1]
        parts.append(
            f'<rect class="box" x="{x - BOX[0] / 2:.0f}" y="{y - BOX[1] / 2:.0f}" '
            f'width="{BOX[0]}" height="{BOX[1]}" rx="6"/>'
            f'<text class="name" x="{x:.0f}" y="{y - 3 if made else y + 4:.0f}" '
            f'text-anchor="middle">{box.name}</text>'
        )
        if made:
            at = f'x="{x:.0f}" y="{y + 15:.0f}"'
            parts.append(f'<text class="made" {at} text-anchor="middle">{made}</text>')
    return "\n".join([*parts, "</svg>", ""])


def pictures() -> dict[str, str]:
    """Return the pictures by their file names."""
    return {
        "slip-flow.svg": picture("slip", *slip_flow()),
        "twist-flow.svg": picture("twist", *twist_flow()),
    }


if __name__ == "__main__":
    for file, text in pictures().items():
        (FOLDER / file).write_text(text, encoding="utf-8")
