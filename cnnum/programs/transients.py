"""Templates inside a program."""

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral

import numpy as np

from cnnum.errors import ProgramError, say_once
from cnnum.graph.nodes import Graph, Node, Pick, RunSpec, Transient
from cnnum.programs.fields import Field, as_field, graph_of, maximum, minimum
from cnnum.renamed import renamed
from cnnum.safety.values import expect
from cnnum.templating.library import as_template
from cnnum.templating.network import last_change
from cnnum.templating.template import Duration, Template


@dataclass(frozen=True, slots=True)
class Applied:
    """The results of a template: outputs and states by layer, and figures of the run.

    Attributes
    ----------
    outputs, states : tuple of Field
        One map per layer.
    settled : Field
        Flag: the array has come to rest.
    error : Field
        Estimated largest error of the states. It is 1e30 or more where nothing is known of it, as
        for steps whose error is not followed. `Result.error` is infinite then.
    time : Field
        Time reached, in the unit of the template's τ.
    steps : Field
        Taken, rejected ones counted.
    """

    outputs: tuple[Field, ...]
    states: tuple[Field, ...]
    settled: Field
    error: Field
    time: Field
    steps: Field


def transient(
    template: Template | str,
    *,
    input: Field | Sequence[Field] | None = None,
    previous: Field | Sequence[Field] | None = None,
    state: Field | Sequence[Field] | None = None,
    bias: Field | Sequence[Field] | None = None,
    mask: Field | None = None,
    weights: Sequence[Field] = (),
    spec: RunSpec | None = None,
) -> Applied:
    """Run a template inside a program and return its results.

    Parameters
    ----------
    template : Template or str
        A template, or the name of one of the library.
    input : Field or sequence of Field, optional
        One map per input of the template. A template without inputs that starts from its input
        takes it as the initial state.
    previous : Field or sequence of Field, optional
        Inputs before the start, for a template with delays. The default is `input`.
    state : Field or sequence of Field, optional
        Initial state, one map per layer. The default is that of the template. If the output
        function limits the state, states beyond ±1 begin at ±1.
    bias : Field or sequence of Field, optional
        Bias map added to z, one map per layer.
    mask : logic Field, optional
        Fixed-state mask: where it holds, the state keeps its value.
    weights : sequence of Field
        Maps whose cells hold the numbers of a template for each frame, as `cnnum.runs.batches`
        packs them. The template itself then only determines which weights exist and how fast the
        array can be.
    spec : RunSpec, optional
        Duration, method and tolerances.

    Raises
    ------
    ProgramError
        If the number of maps does not fit the template, an argument has the wrong type, or a
        template whose gains change in time is to run to equilibrium.
    """
    template = _template(template)
    if spec is not None:
        expect("spec", spec, RunSpec, ProgramError)
    duration = template.duration if spec is None or spec.duration is None else spec.duration
    if isinstance(duration, str) and last_change(template) > 0.0:
        raise ProgramError(
            f"Template '{template.name}' has a gain in time, so that a state that does not move "
            "may move later: give it a duration, as in spec=RunSpec(duration=10.0)."
        )
    return added(
        template, input=input, previous=previous, state=state, bias=bias, mask=mask,
        weights=weights, spec=spec,
    )  # fmt: skip


def added(
    template: Template,
    *,
    input: Field | Sequence[Field] | None = None,
    previous: Field | Sequence[Field] | None = None,
    state: Field | Sequence[Field] | None = None,
    bias: Field | Sequence[Field] | None = None,
    mask: Field | None = None,
    weights: Sequence[Field] = (),
    spec: RunSpec | None = None,
) -> Applied:
    """Add a transient to a graph, as `transient` does, whose end the caller looks at."""
    if template.inputs == 0 and template.initial == "input" and state is None:
        state, input = input, None
    if template.needs_state and state is None:
        say_once(template.without_state())
    if template.output.limited:
        state = _within_limits(template, input, state)
    given = [
        *_several(template, "input", input, template.inputs),
        *_several(template, "previous", previous, template.inputs),
        *_several(template, "state", state, template.layers),
        *_several(template, "bias", bias, template.layers),
    ]
    if not given and mask is None:
        raise ProgramError(f"Template '{template.name}' needs at least one map of the frame.")
    if template.initial == "input" and input is None and state is None:
        raise ProgramError(f"Template '{template.name}' starts from its input: pass an input.")
    if template.inputs and input is None:
        raise ProgramError(f"Template '{template.name}' needs {template.inputs} input map(s).")
    if mask is not None:
        expect("mask", mask, Field, ProgramError)
        if not mask.logic:
            raise ProgramError("A mask is a logic map: compare the values first.")
        given.append(mask)
    given += _fields("weights", weights)
    graph = graph_of(given)
    if any(item.maps > 1 for item in given):
        raise ProgramError(f"Template '{template.name}' runs on single maps, not on a stack.")
    operation = Transient(
        template,
        template.digest,
        spec or RunSpec(),
        has_previous=previous is not None,
        has_state=state is not None,
        has_bias=bias is not None,
        has_mask=mask is not None,
        weight_maps=len(weights),
    )
    node = graph.add(operation, *(as_field(graph, item).node for item in given))
    return _applied(graph, node, template.layers)


def _within_limits(
    template: Template, input: Field | Sequence[Field] | None, state: Field | Sequence[Field] | None
) -> list[Field] | None:
    """Return the maps that a limited state starts from; None where no map is."""
    if state is None and template.initial == "input":
        state = input
    if state is None:
        return None
    return [
        minimum(maximum(field, -1.0), 1.0)
        for field in _several(template, "state", state, template.layers)
    ]


def _applied(graph: Graph, node: Node, layers: int) -> Applied:
    def pick(what: str, layer: int = 0, *, scalar: bool = False) -> Field:
        logic = what == "settled"
        return Field(graph, graph.add(Pick(what, layer), node, scalar=scalar, logic=logic))

    return Applied(
        outputs=tuple(pick("output", layer) for layer in range(layers)),
        states=tuple(pick("state", layer) for layer in range(layers)),
        settled=pick("settled", scalar=True),
        error=pick("error", scalar=True),
        time=pick("time", scalar=True),
        steps=pick("steps", scalar=True),
    )


def _several(
    template: Template, role: str, value: Field | Sequence[Field] | None, count: int
) -> list[Field]:
    if value is None:
        return []
    fields = _fields(role, [value] if isinstance(value, Field) else value)
    if len(fields) != count:
        raise ProgramError(
            f"Template '{template.name}' takes {count} map(s) as {role}, got {len(fields)}."
        )
    return fields


def _fields(role: str, value: Sequence[Field]) -> list[Field]:
    expect(role, value, Sequence, ProgramError)
    for field in value:
        expect(role, field, Field, ProgramError)
    return list(value)


def apply(
    template: Template | str,
    *,
    input: Field | Sequence[Field] | None = None,
    state: Field | Sequence[Field] | None = None,
    bias: Field | Sequence[Field] | None = None,
    mask: Field | None = None,
    duration: Duration | None = None,
) -> Field:
    """Run a template of one layer inside a program and return its output map.

    The arguments are those of `transient`, which also returns states, layers and statistics of the
    run.

    Raises
    ------
    ProgramError
        If the template has several layers, or an argument has the wrong type.
    """
    template = _template(template)
    if template.layers != 1:
        raise ProgramError(
            f"Template '{template.name}' has {template.layers} layers: use cnnum.transient, "
            "whose result names them."
        )
    run = transient(
        template, input=input, state=state, bias=bias, mask=mask, spec=RunSpec(duration=duration)
    )
    return run.outputs[0]


def _template(template: object) -> Template:
    if not isinstance(template, Template | str):
        raise ProgramError(
            f"Expected a template or the name of one, got {type(template).__name__}."
        )
    return as_template(template)


@renamed(columns="cols")
def shift(field: Field, rows: int = 0, cols: int = 0, *, boundary: float | str = 0.0) -> Field:
    """Return a map moved by whole cells: down by `rows`, to the right by `cols`.

    Parameters
    ----------
    field : Field
    rows, cols : int
    boundary : float, "zero-flux" or "periodic"
        Values that move in from beyond the rim.

    Raises
    ------
    ProgramError
        If `field` is not a field, or `rows` and `cols` are not whole numbers within the array.
    """
    expect("field", field, Field, ProgramError)
    for name, cells, most in zip(("rows", "cols"), (rows, cols), field.graph.shape, strict=True):
        if not isinstance(cells, Integral) or abs(cells) > most:
            raise ProgramError(
                f"'{name}' of a shift must be a whole number of cells, at most the {most} of the "
                f"array, got {cells!r:.60}."
            )
    radius = max(abs(rows), abs(cols))
    kernel = np.zeros((2 * radius + 1, 2 * radius + 1))
    kernel[radius - rows, radius - cols] = 1.0
    name = f"shift {rows} down, {cols} right"
    template = Template(
        name, np.zeros((1, 1)), kernel, boundary=boundary, duration="settle", output="linear"
    )
    moved = apply(template, input=field)
    return moved > 0.5 if field.logic else moved
