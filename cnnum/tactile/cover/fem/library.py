"""The one door to scikit-fem."""

from importlib import import_module
from typing import Any

from cnnum.errors import missing_extra


def load_skfem() -> Any:
    """Return the module scikit-fem; it carries no types of its own.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        return import_module("skfem")
    except ImportError:
        raise missing_extra(
            "finite elements", "scikit-fem", "fem", "or use the coefficients that are shipped"
        ) from None
