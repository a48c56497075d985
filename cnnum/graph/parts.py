"""The parts of a program: templates with and without feedback, local operations, read-outs."""

from collections.abc import Iterable
from dataclasses import astuple, dataclass

from cnnum.graph.nodes import Apply, Loop, Node, Reduce, Transient
from cnnum.templating.reads import delays_outputs, reads_outputs, reads_states
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True)
class Parts:
    """How many operations of each kind a program has; those in bodies of loops count once.

    Attributes
    ----------
    feedback, feedforward : int
        Templates whose cells see outputs or states, and those whose cells see inputs alone.
    local : int
        Local arithmetic and logic on maps.
    reductions : int
        Global read-outs: a map becomes one number.
    scalar : int
        Arithmetic and logic on one number a frame.
    """

    feedback: int = 0
    feedforward: int = 0
    local: int = 0
    reductions: int = 0
    scalar: int = 0

    def __str__(self) -> str:
        return (
            f"{self.feedback} templates with feedback and {self.feedforward} without, "
            f"{self.local} local operations, {self.reductions} reductions, "
            f"{self.scalar} operations on numbers"
        )

    def __add__(self, other: "Parts") -> "Parts":
        return Parts(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))


def parts_of(nodes: Iterable[Node]) -> Parts:
    """Return the parts of nodes and of the bodies of their loops."""
    found = Parts()
    for node in nodes:
        match node.operation:
            case Transient() as run:
                fed = has_feedback(run.template)
                found += Parts(feedback=int(fed), feedforward=int(not fed))
            case Reduce():
                found += Parts(reductions=1)
            case Apply():
                found += Parts(scalar=1) if node.scalar else Parts(local=1)
            case Loop() as loop:
                found += parts_of(loop.nodes)
            case _:
                pass
    return found


def has_feedback(template: Template) -> bool:
    """Return whether a template's cells see outputs or states, their own but for its decay."""
    return reads_outputs(template) or reads_states(template) or delays_outputs(template)
