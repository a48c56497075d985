"""Unwanted parts are gone: operations, channels, templates and maps, by count."""

from collections import Counter

import pytest

from cnnum.frame import FORCE_AXES
from cnnum.graph.nodes import Transient
from cnnum.graph.schedule import schedule
from cnnum.lab.bench.scene_costs import measure_scenes
from cnnum.scenes.pipeline import load_scene
from cnnum.templates.tactile.tactile import tactile

GRAPH = tactile.trace((8, 8))
WHOLE = schedule(GRAPH, FORCE_AXES, None)


# the pull is laid out and taken off twice before the pressure is known
PULLED = 2 * ["pulled x 0.5", "pulled y 0.5", "unblur strain 0.5"]
PRESSED = sorted(["contact_threshold", *PULLED])
# smoothed and delayed loads: three maps of each, and for the twist one that is delayed
GRADIENTS = ["gradient_x", "gradient_y"]
SLIP = ["RECALL", *GRADIENTS, *6 * ["leaky_cell"], *2 * ["tactile_diffusion"]]
TWIST = [*4 * ["leaky_cell"], "shear_curl", "shear_divergence"]


def thinned(*needs):
    return schedule(GRAPH, FORCE_AXES, needs)


def templates(plan):
    nodes = (node.operation for node in plan.transients)
    return sorted(node.template.name for node in nodes if isinstance(node, Transient))


def outside_loops(plan):
    """Templates that run once a frame; those of a loop go with it, and are not named."""
    runs = (node.operation for node in plan.nodes)
    return [operation.template.name for operation in runs if isinstance(operation, Transient)]


def said(plan, kind):
    """How often a plan names each thing of a kind as left out."""
    named = (item.what for item in plan.left_out)
    return Counter(what.removeprefix(f"{kind} ") for what in named if what.startswith(f"{kind} "))


@pytest.mark.parametrize(
    ("needs", "channels", "wanted"),
    [
        (("contact",), ("normal",), ["smooth"]),
        (("contact_row", "contact_column"), FORCE_AXES, sorted([*PRESSED, "smooth"])),
        (("load_x",), FORCE_AXES, sorted([*PRESSED, "around 1", "left strain 0.5", "smooth"])),
        (("edge_load",), ("normal",), [*2 * ["between_neighbours"], "smooth", "unblur strain 0.5"]),
        (("bump_count",), FORCE_AXES, ["smooth", "unmix"]),
        (("bump_load_x",), FORCE_AXES, ["smooth", "unmix"]),
        (("gross_slip",), FORCE_AXES, SLIP),
        (("twist",), FORCE_AXES, TWIST),
        (("twist_row",), ("normal",), ["leaky_cell"]),
    ],
)
def test_only_what_a_need_reaches_is_left(needs, channels, wanted):
    plan = thinned(*needs)
    assert plan.channels_read == tuple(channels)
    # all of them look for taxels that fall below rest alone: by the eight neighbours
    assert [one for one in templates(plan) if not one.startswith("shift")] == wanted
    assert len(plan.nodes) < len(WHOLE.nodes)
    # all the rest is said to be left out, once each, and nothing else
    assert said(plan, "output") == Counter(set(WHOLE.outputs) - set(needs))
    assert said(plan, "channel") == Counter(set(FORCE_AXES) - set(channels))
    assert said(plan, "template") == Counter(outside_loops(WHOLE)) - Counter(outside_loops(plan))


def test_counts_of_memories():
    """Contact keeps numbers and eleven maps; slip nine of rest, six of leaky cells, a frame, and
    the region that sticks.
    """
    maps = {
        flag: sum(not memory.read.scalar for memory in thinned(flag).memories.values())
        for flag in ("contact", "gross_slip", "twist")
    }
    # rest, its two extremes and mean at first, a late mean, where it last moved and for how long
    # not; the frame before, its change, its noise, and which taxels broke
    assert maps["contact"] == 7 + 4
    assert maps["gross_slip"] == 3 * 3 + 6 + 1 + 1
    assert maps["twist"] == 3 * 3 + 4 + 1
    both = thinned("gross_slip", "twist").memories.values()
    assert sum(not memory.read.scalar for memory in both) == maps["gross_slip"]


def test_slip_and_twist_share_what_they_start_from():
    both = len(thinned("gross_slip", "twist").nodes)
    one, other = len(thinned("gross_slip").nodes), len(thinned("twist").nodes)
    assert both < one + other / 2


def test_maps_are_read_back_only_where_wanted(fast):
    flags = fast.compile(tactile, (8, 8), ["contact"]).explain()
    maps = fast.compile(tactile, (8, 8), ["contact", "contact_map"]).explain()
    assert flags.maps_read_back == ()
    assert maps.maps_read_back == ("contact_map",)
    assert flags.bytes_out == 4
    assert flags.bytes_in == 4 * 64


SCENES = {
    # scene: channels that it reads, maps that it reads back, templates that it does without
    "contact": (FORCE_AXES, (), ("unmix",)),
    "edges": (("normal",), ("edges",), ("contact_threshold", "unmix")),
    "slip": (FORCE_AXES, (), ("unmix",)),
    "twist": (FORCE_AXES, (), ("unmix",)),
    "localize": (
        (*FORCE_AXES, "saturated"),  # its shear is unknown where a taxel is at its end
        ("bump_contact", "bump_load_x", "bump_load_y", "bump_load_normal"),
        ("contact_threshold",),
    ),
}


@pytest.fixture(scope="module")
def whole():
    return load_scene("tactile")


@pytest.fixture(scope="module")
def scenes():
    """Each scene loaded once: a plan is the same for all that is asked of it."""
    return {name: load_scene(name) for name in SCENES}


def texts_of(source):
    """Lines of a kernel's text that read, keep and give, by where they go."""
    body = source[source.index("__kernel") :].splitlines()
    return {
        name: [line for line in body if f"{call}({name} +" in line]
        for name, call in (("input", "gather"), ("output", "scatter"))
    }


def test_everything_is_everything(whole):
    assert set(whole.plan.schedule.outputs) == set(WHOLE.outputs)
    assert {rule.kind for rule in whole.rules} == {"contact", "slip", "twist", "edge"}
    assert not [item for item in whole.plan.explain().left_out if item.what.startswith("output")]


@pytest.mark.parametrize("name", SCENES)
def test_scene_runs_what_it_wants_and_no_more(name, whole, scenes):
    channels, maps, without = SCENES[name]
    scene = scenes[name]
    plan, everything = scene.plan.explain(), whole.plan.explain()
    assert (plan.channels_read, plan.maps_read_back) == (channels, maps)
    numbers = len(scene.plan.schedule.outputs) - len(maps)
    assert plan.bytes_in == 4 * 64 * len(channels)
    assert plan.bytes_out == 4 * (64 * len(maps) + numbers) < everything.bytes_out / 2
    assert plan.ops < everything.ops
    assert plan.flops < everything.flops
    # parts that are gone are said, and nothing else is
    gone = {item.what.removeprefix("output ") for item in plan.left_out if "output " in item.what}
    assert gone == set(WHOLE.outputs) - set(scene.plan.schedule.outputs)
    for template in without:
        assert f"template {template}" in {item.what for item in plan.left_out}


@pytest.mark.parametrize("name", SCENES)
def test_kernel_and_buffers_hold_no_more_than_that(name, opencl, whole, scenes):
    channels, maps, without = SCENES[name]
    scene = scenes[name]
    text, everything = scene.plan.source, whole.plan.source
    lines, all_lines = texts_of(text), texts_of(everything)
    assert len(lines["input"]) == len(channels)
    # a line for every output, and one that says whether all came to its end
    assert len(lines["output"]) == len(scene.plan.schedule.outputs) + 1
    assert len(all_lines["output"]) == len(WHOLE.outputs) + 1
    for template in without:
        assert f"// {template}: " not in text
        assert f"// {template}: " in everything
    assert len(text) < len(everything)
    executable = scene.plan.executable
    one = executable.one(executable.new_memory(1))
    numbers = len(scene.plan.schedule.outputs) - len(maps)
    assert len(one.output.host) == 64 * len(maps) + numbers + 1


def test_values_that_travel_are_those_of_channels_that_are_read(opencl):
    scene = load_scene("edges", engine=opencl)
    frame = next(iter(scene.driver.frames()))
    way = scene.path()
    assert frame.values.shape == (8, 8, 4)
    assert way.step(0, frame).values.shape == (8, 8, 1)
    assert scene.plan.executable.one(scene.plan.executable.new_memory(1)).given.shape == (8, 8, 1)


@pytest.fixture(scope="module")
def all_events(whole):
    return list(whole.events())


@pytest.mark.parametrize("name", ["contact", "slip", "twist"])
def test_events_are_those_of_the_scene_that_wants_everything(name, scenes, all_events):
    """The parts left out change nothing of the rest."""
    kinds = {"contact": {"contact", "release"}}.get(name, {name})
    thin, full = (
        [(event.time, event.kind, event.phase) for event in events if event.kind in kinds]
        for events in (scenes[name].events(), all_events)
    )
    assert thin
    assert thin == full


@pytest.mark.in_full("test_events_are_those_of_the_scene_that_wants_everything")
def test_cost_of_scenes_states_what_was_left_out_and_changes_no_answer(fast):
    """How much time that saves is the benchmark's to say: a busy machine may not decide a test."""
    measured = measure_scenes(fast, rounds=1, every=100)
    rows = {row.case: row for row in measured if row is not None}
    assert rows["tactile"].share == 1.0
    assert rows["tactile"].saved_us == 0.0
    assert all(row.p99_us >= row.p50_us > 0.0 for row in rows.values())
    assert rows["contact"].ops < rows["tactile"].ops / 2
    # 60 frames of rest and 20 more of the press, the pull, the twist and after
    assert all(row.compared == 80 for row in rows.values())
    # float32 through some hundred operations; a strength is a ratio of small differences. The rate
    # of a twist that tactile gives is no part of this: of a few frames it is anything
    assert all(rows[name].error < 5e-3 for name in SCENES)
    # a taxel's edge can lie within rounding of its level in one of the frames
    assert all(row.flips <= 1 for row in rows.values())
