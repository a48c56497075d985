"""What nothing asks for is gone: operations, channels, templates and maps, by count."""

import pytest

from cnnum.frame import FORCE_AXES
from cnnum.graph.nodes import Transient
from cnnum.graph.passes import schedule
from cnnum.templates.tactile.tactile import tactile

GRAPH = tactile.trace((8, 8))
WHOLE = schedule(GRAPH, FORCE_AXES, None)


def thinned(*needs):
    return schedule(GRAPH, FORCE_AXES, needs)


def templates(plan):
    nodes = (node.operation for node in plan.transients)
    return sorted(node.template.name for node in nodes if isinstance(node, Transient))


@pytest.mark.parametrize(
    ("needs", "channels", "wanted"),
    [
        (("contact",), ("normal",), []),
        (("contact_row", "contact_column"), ("normal",), ["contact_threshold"]),
        (("edge_load",), ("normal",), ["unblur strain 0.5"]),
        (("bump_count",), FORCE_AXES, ["unmix"]),
        (("bump_load_x",), FORCE_AXES, ["unmix"]),
        (("gross_slip",), FORCE_AXES, ["smooth"]),
        (("twist",), FORCE_AXES, ["smooth"]),
        (("twist_row",), ("normal",), []),
    ],
)
def test_only_what_a_need_reaches_is_left(needs, channels, wanted):
    plan = thinned(*needs)
    assert plan.channels_read == tuple(channels)
    assert templates(plan) == wanted
    assert len(plan.nodes) < len(WHOLE.nodes)
    assert {item.what for item in plan.left_out} >= {
        f"output {name}" for name in WHOLE.outputs if name not in needs
    } or plan.left_out


def test_counts_of_memories_and_nodes():
    """Contact keeps numbers and three maps at most; slip's windows keep 31 maps a channel."""
    contact, slip = thinned("contact"), thinned("gross_slip")
    maps = {
        name: sum(not memory.read.scalar for memory in plan.memories.values())
        for name, plan in (("contact", contact), ("slip", slip))
    }
    assert maps["contact"] == 2  # rest, and the frame before for the noise
    # 3 windowed channels of 1 + 2 + 4 + 8 + 16; rest and frame before of 3; free shear of 2
    assert maps["slip"] == 3 * 31 + 3 + 3 + 2
    assert len(contact.nodes) < 80 < 400 < len(slip.nodes)


def test_slip_and_twist_share_all_but_their_flags():
    both = len(thinned("gross_slip", "twist").nodes)
    one, other = len(thinned("gross_slip").nodes), len(thinned("twist").nodes)
    assert both < max(one, other) + 60


def test_maps_are_read_back_only_where_wanted(opencl):
    flags = opencl.compile(tactile, (8, 8), ["contact"]).explain()
    maps = opencl.compile(tactile, (8, 8), ["contact", "contact_map"]).explain()
    assert flags.maps_read_back == ()
    assert maps.maps_read_back == ("contact_map",)
    assert flags.bytes_out == 4
    assert flags.bytes_in == 4 * 64
