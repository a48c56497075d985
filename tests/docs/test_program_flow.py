"""The flow diagrams of slip and twist are those of the programs as they are."""

import pytest

from cnnum.graph.schedule import schedule
from docs.figures.program_flow import FOLDER, Box, behind, pictures, slip_flow, twist_flow


@pytest.mark.parametrize("name", ["slip-flow.svg", "twist-flow.svg"])
def test_flow_is_drawn_as_it_is(name):
    drawn = (FOLDER / name).read_text(encoding="utf-8")
    assert drawn == pictures()[name], "run 'python -m docs.figures.program_flow'"


@pytest.mark.parametrize("flow", [slip_flow, twist_flow])
def test_every_template_of_a_program_is_in_a_box(flow):
    traced, drawn = flow()
    boxes = [Box(title, tuple(nodes), place, group) for title, nodes, place, group in drawn]
    made = [behind(traced, box, boxes) for box in boxes]
    thinned = schedule(traced.graph, ("shear_x", "shear_y", "normal"), None)
    shown = sum(
        int(part.split(" × ")[0])
        for _, text in made
        for part in text.split(", ")
        if part and not part.endswith(("sum", "largest"))
    )
    assert shown == len(thinned.transients)
    assert all(read or box.group == "" for (read, _), box in zip(made, boxes, strict=True))
