"""Design of templates: from rules and examples to weights, with a proof of their answers.

`cnnum.design.sweep` runs experiments over weights, sizes, noise and mismatch.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cnnum.design.sweeping import sweep

__all__ = ["sweep"]


def __getattr__(name: str) -> object:
    """Import `sweep` when it is first asked for: it brings engines."""
    if name != "sweep":
        raise AttributeError(f"module 'cnnum.design' has no attribute '{name}'")
    from cnnum.design.sweeping import sweep

    return sweep
