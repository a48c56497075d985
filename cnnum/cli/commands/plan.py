"""`cnnum plan`: the operations of a scene, those left out and why."""

from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from cnnum.cli.following import left_out_records
from cnnum.cli.options import Changes, completed, json_option, scene_options, trust_option
from cnnum.cli.output import Output, facts, quantity, table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cnnum.plan import Explanation, Plan
    from cnnum.runs.planning import OpGroup
    from cnnum.scenes.arrangement import Given


@click.command("plan")
@click.argument("scene", shell_complete=completed("scene", files=True))
@scene_options
@trust_option
@click.option(
    "--ops", is_flag=True, help="List the operations by function; with --json by line as well."
)
@click.option("--lines", is_flag=True, help="With --ops, list the lines of each function as well.")
@click.option("--source", is_flag=True, help="Print the source of the kernels instead.")
@json_option
def command(
    scene: str,
    changes: Changes,
    ops: bool,
    lines: bool,
    source: bool,
    trust: bool,
    as_json: bool,
) -> None:
    """Show which operations SCENE runs per frame, which it leaves out, and what that saves."""
    if lines and not ops:
        raise click.UsageError("--lines requires --ops.")
    from cnnum.scenes.arrangement import given_by
    from cnnum.scenes.pipeline import load_scene

    output = Output(as_json)
    opened = load_scene(scene, changes=changes, trust=trust)
    with opened.driver:
        explanation, text = opened.plan.explain(), opened.plan.source if source else ""
        gives = () if ops or source else given_by(opened.shape, opened.conversion.channels)
    if ops:
        _show_ops(output, opened.plan, lines)
        return
    if source:
        output.record({"scene": opened.spec.name, "source": text}, text)
        return
    record = _record(opened.spec.name, opened.spec.needs, explanation)
    output.record({**record, "gives": [asdict(given) for given in gives]})
    _show(output, opened.spec.name, opened.spec.needs, explanation)
    _show_given(output, gives)


def _show_ops(output: Output, plan: "Plan", lines: bool) -> None:
    """Print the operations by function, and by line if asked to; as records always by line."""
    from cnnum.runs.planning import by_function, op_groups

    groups = op_groups(plan.built, dict(plan.solvers))
    for group in groups:
        output.record(asdict(group))
    made = table("Function", ">ops", ">flops", ">results", ">live at most")
    for function in by_function(groups):
        made.add_row(*_ops_row(function.program, function))
        for group in sorted(groups, key=lambda group: group.line) if lines else ():
            if group.program == function.program:
                made.add_row(*_ops_row(f"  line {group.line}", group))
    output.show(made)


def _ops_row(name: str, group: "OpGroup") -> tuple[str, ...]:
    sizes = (quantity(group.bytes, "B"), quantity(group.live_bytes, "B"))
    return (name, str(group.count), quantity(group.flops, "flop"), *sizes)


def _record(scene: str, wants: tuple[str, ...], plan: "Explanation") -> dict[str, object]:
    return {
        "scene": scene,
        "needs": wants,
        "program": plan.program,
        "shape": plan.shape,
        "ops": plan.ops,
        "ops_most": plan.ops_most,
        "parts": asdict(plan.parts),
        "launches": plan.launches,
        "channels_read": plan.channels_read,
        "maps_read_back": plan.maps_read_back,
        "transients": plan.transients,
        "flops": plan.flops,
        "flops_most": plan.flops_most,
        "bytes_in": plan.bytes_in,
        "private_bytes": plan.private_bytes,
        "local_bytes": plan.local_bytes,
        "scratch_bytes": plan.scratch_bytes,
        "bytes_out": plan.bytes_out,
        "engine": plan.engine,
        "device": plan.device,
        "precision": plan.precision,
        "left_out": left_out_records(plan.left_out),
    }


def _show(output: Output, scene: str, wants: tuple[str, ...], plan: "Explanation") -> None:
    from cnnum.graph.schedule import grouped

    rows, cols = plan.shape
    output.show(
        facts(
            (
                ("scene", f"{scene}: wants {', '.join(wants)}"),
                ("program", f"{plan.program} on {rows}×{cols} cells"),
                ("runs on", f"{plan.device}, {plan.engine}, {plan.precision}"),
                (
                    "a frame",
                    f"{plan.ops} operations in {plan.launches} launch(es), "
                    f"{quantity(plan.flops, 'flop')}, "
                    f"{quantity(plan.bytes_in, 'B')} in, {quantity(plan.bytes_out, 'B')} out",
                ),
                ("made of", str(plan.parts)),
                *_most(plan),
                ("channels read", ", ".join(plan.channels_read) or "none"),
                ("maps read back", ", ".join(plan.maps_read_back) or "none"),
            )
        )
    )
    runs = table("Templates that run")
    for text in plan.transients:
        runs.add_row(text)
    gone = table("Left out", "why", "saves per frame")
    for item in grouped(plan.left_out):
        gone.add_row(item.what, item.why, item.saves)
    output.show(*(part for part in (runs, gone) if part.row_count))
    if not plan.left_out:
        output.show("Nothing is left out.")


def _show_given(output: Output, gives: "Sequence[Given]") -> None:
    """Say which events programs can give of the array's axes, and which it lacks an axis for."""
    if not any(given.missing for given in gives):
        return
    made = table("This array", "programs, or what is missing")
    for given in gives:
        if given.missing:
            made.add_row(f"cannot give {given.event}", f"reads no {' and no '.join(given.missing)}")
        else:
            made.add_row(f"can give {given.event}", ", ".join(given.programs))
    output.show(made)


def _most(plan: "Explanation") -> tuple[tuple[str, str], ...]:
    """Return the line on the cost of loops at their limits, where there are any."""
    if (plan.ops_most, plan.flops_most) == (plan.ops, plan.flops):
        return ()
    most = f"{plan.ops_most} operations, {quantity(plan.flops_most, 'flop')}"
    return (("at the loops' limits", most),)
