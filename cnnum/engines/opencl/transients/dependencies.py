"""What a template's equations read of inputs, states and earlier outputs."""

from cnnum.engines.opencl.transients.builder import TransientBuilder


def reads_inputs(text: TransientBuilder) -> bool:
    """Return whether anything reads the padded inputs."""
    template = text.template
    return bool(
        template.B.any()
        or (template.delayed is not None and template.delayed.B.any())
        or any("u" in (c.neighbour, c.centre) for c in template.nonlinear)
    )


def pads_inputs(text: TransientBuilder) -> bool:
    """Return whether any cell is driven by what its neighbours are given."""
    template = text.template
    radius = template.B.shape[-1] // 2
    beside = template.B.copy()
    beside[..., radius, radius] = 0.0
    delays = template.delayed is not None and bool(template.delayed.B.any())
    couples = any("u" in (c.neighbour, c.centre) for c in template.nonlinear)
    return bool(beside.any()) or delays or couples


def has_history(text: TransientBuilder) -> bool:
    """Return whether delayed inputs were others before the start."""
    delayed = text.template.delayed
    return delayed is not None and bool(delayed.B.any()) and bool(text.operands.previous)


def pads_states(text: TransientBuilder) -> bool:
    """Return whether a coupling reads the states (not outputs) of cells."""
    return any("x" in (c.neighbour, c.centre) for c in text.template.nonlinear)


def pads_outputs(text: TransientBuilder) -> bool:
    """Return whether a coupling reads the outputs of cells."""
    template = text.template
    return bool(template.A.any()) or any("y" in (c.neighbour, c.centre) for c in template.nonlinear)


def delays_outputs(text: TransientBuilder) -> bool:
    """Return whether the template has a delayed A."""
    delayed = text.template.delayed
    return delayed is not None and bool(delayed.A.any())


def inputs_read(text: TransientBuilder) -> list[int]:
    """Return the inputs that the cells go on reading as their states change."""
    moving = [coupling for coupling in text.template.nonlinear if not coupling.static]
    found = {coupling.source for coupling in moving if coupling.neighbour == "u"}
    return sorted(found | {c.centre_source for c in moving if c.centre == "u"})
