"""A whole program is one kernel launch a batch: the events that OpenCL hands back are counted."""

import numpy as np
import pyopencl as cl
import pytest

import cnnum


@pytest.fixture
def launches(monkeypatch):
    """Collect the event of every kernel that is enqueued."""
    events = []
    enqueue = cl.enqueue_nd_range_kernel

    def counted(*args, **kwargs):
        event = enqueue(*args, **kwargs)
        events.append(event)
        return event

    monkeypatch.setattr(cl, "enqueue_nd_range_kernel", counted)
    monkeypatch.setattr(cl.Kernel, "__call__", None)  # there is no other way to launch
    return events


@pytest.mark.parametrize("batch", [(), (40,)])
def test_slip_program_is_one_launch_a_frame(launches, batch):
    plan = cnnum.Engine().compile(cnnum.get_program("slip"), (8, 8))
    stream = plan.stream(batch)
    for frame in np.random.default_rng(0).normal(0.0, 1e-3, (3, *batch, 8, 8, 3)):
        stream.push(frame)
    assert plan.explain().launches == 1
    assert len(launches) == 3
    kinds = {event.command_type for event in launches}
    assert kinds == {cl.command_type.NDRANGE_KERNEL}
