"""The result of `auto`, or of a method that is asked for, on an array."""

import pytest

from cnnum.graph.nodes import RunSpec, Transient
from cnnum.integrators.choice import choose


@pytest.fixture(scope="session")
def solver_for():
    """Return a template's solver on a shape, of a run with a state of its own."""

    def solver(template, shape, *, has_mask=False, **spec):
        operation = Transient(
            template,
            template.digest,
            RunSpec(**spec),
            has_previous=False,
            has_state=True,
            has_bias=False,
            has_mask=has_mask,
        )
        return choose(operation, shape)

    return solver
