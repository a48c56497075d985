"""The kernels of a built plan by their names."""

from dataclasses import dataclass, field
from typing import Any

import pyopencl as cl


@dataclass(slots=True, eq=False)
class PlanKernels:
    """Makes each kernel once, and launches it; the program is kept, or Intel's is lost.

    Attributes
    ----------
    queue : CommandQueue
    program : Program
    """

    queue: cl.CommandQueue
    program: cl.Program
    _made: dict[str, cl.Kernel] = field(default_factory=dict[str, cl.Kernel])

    def __getitem__(self, name: str) -> cl.Kernel:
        if name not in self._made:
            self._made[name] = self.separate(name)
        return self._made[name]

    def separate(self, name: str) -> cl.Kernel:
        """Return a kernel that keeps arguments of its own."""
        return cl.Kernel(self.program, name)

    def launch(self, name: str, items: tuple[int, ...], *arguments: Any) -> None:
        """Launch a kernel in groups of one item; without arguments, those set before stay."""
        kernel = self[name]
        if arguments:
            kernel.set_args(*arguments)
        cl.enqueue_nd_range_kernel(self.queue, kernel, items, (1,) * len(items))
