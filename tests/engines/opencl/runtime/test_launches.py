"""A whole program is one kernel launch a batch: the events that OpenCL hands back are counted."""

import numpy as np
import pyopencl as cl
import pytest

import cnnum
from cnnum.engines.devices.program_cache import build_program
from cnnum.engines.opencl.executable import QUIET
from cnnum.graph.nodes import RunSpec


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
def test_slip_program_is_one_launch_a_frame(launches, opencl, batch):
    plan = opencl.compile(cnnum.get_program("slip"), (8, 8))
    stream = plan.stream(batch, rate=200.0)
    for frame in np.random.default_rng(0).normal(0.0, 1e-3, (3, *batch, 8, 8, 3)):
        stream.push(frame)
    assert plan.explain().launches == 1
    assert len(launches) == 3
    kinds = {event.command_type for event in launches}
    assert kinds == {cl.command_type.NDRANGE_KERNEL}


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("shape", "method"), [((40, 40), "euler"), ((260, 260), "euler"), ((260, 260), "rk4")]
)
def test_a_large_array_takes_the_launches_that_its_plan_states(launches, shape, method):
    """One work item up to 256×256 cells; strips and parts beyond, with no round to guess."""
    template = cnnum.Template("weak", [[0, 0.1, 0], [0.1, 0.3, 0.1], [0, 0.1, 0]], [[1.0]])
    spec = RunSpec(duration=2.0, method=method, dt=0.1)

    @cnnum.program
    def weak(frame):
        return {"y": cnnum.transient(template, input=frame.channel("a"), spec=spec).outputs[0]}

    plan = cnnum.Engine("opencl").compile(weak, shape, channels=("a",))
    plan(np.zeros((*shape, 1)))
    assert len(launches) == plan.explain().launches
    assert (len(launches) == 1) == (shape == (40, 40))


@pytest.mark.parametrize("shape", [(8, 8), (40, 40)])
def test_local_memory_is_what_the_device_says(shape):
    """Of the kernel that the plan's own text makes."""
    plan = cnnum.Engine("opencl").compile(cnnum.get_program("slip"), shape)
    queue = plan.executable.queue
    program = build_program(queue.context, plan.source, [QUIET])
    kernel = cl.Kernel(program, "plan")
    kept = kernel.get_work_group_info(cl.kernel_work_group_info.LOCAL_MEM_SIZE, queue.device)
    assert plan.explain().local_bytes == kept
