"""Peeling: templates that remove cells from objects, in turn until nothing changes."""

from collections.abc import Mapping, Sequence

from cnnum.programs.fields import Field
from cnnum.programs.loops import loop
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import apply
from cnnum.templating.library import get_template


def eight(prefix: str) -> tuple[str, ...]:
    """Return the names of a family of eight templates, in order of application."""
    return tuple(f"{prefix}{number}" for number in range(1, 9))


def peeled(frame: FrameFields, names: Sequence[str]) -> Mapping[str, Field]:
    """Apply templates to the black objects of a picture in turn, until nothing changes.

    Returns
    -------
    picture : logic map of the remaining cells.
    rounds : number of iterations, each of which applies all templates.
    """
    templates = [get_template(name) for name in names]

    def peel(objects: Field) -> Field:
        for template in templates:
            objects = apply(template, input=objects.picture()).black()
        return objects

    # each round but the last takes a cell away
    limit = frame.shape[0] * frame.shape[1] + 1
    left = loop(peel, frame.channel("picture").black(), limit=limit)
    return {"picture": left.value, "rounds": left.iterations}
