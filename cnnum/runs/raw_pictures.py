"""Pixels that were given where a template takes a picture: they are refused, with the way out."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.errors import ArrayError
from cnnum.templating.template import Template

PIXELS = 255.0
"""Largest grey level of 8 bits."""

ROLES = ("input", "previous", "state")
"""The maps of a run that can be a picture."""

LEAST_SQUARES = (PIXELS / 2) ** 2
"""Sum of squares below which numbers are no grey levels, for a quick look."""


def refuse_pixels(template: Template, role: str, value: ArrayLike) -> None:
    """Refuse bool and 8-bit pixels as an input or a state.

    Raises
    ------
    ArrayError
        With the function that makes a picture of them.
    """
    kind = getattr(value, "dtype", None)
    if kind is not None and kind in (np.dtype(bool), np.dtype(np.uint8)):
        raise _refusal(template, role, f"an array of {kind}")


def refuse_grey_levels(template: Template, role: str, array: NDArray[np.floating]) -> None:
    """Refuse numbers that are 8-bit grey levels, where the cells saturate at −1 and 1.

    Grey levels are whole numbers from 0 to 255, at least one of them 128 or more.

    Raises
    ------
    ArrayError
        With the function that makes a picture of them.
    """
    if template.output.linear or not array.size:
        return
    low, high = float(array.min()), float(array.max())
    if low >= 0.0 and PIXELS / 2 < high <= PIXELS and bool((array == np.rint(array)).all()):
        raise _refusal(template, role, f"whole numbers of {low:g} to {high:g}")


def refuse_signed_mask(array: NDArray[np.floating]) -> None:
    """Refuse a fixed-state mask with numbers below 0, as other simulators draw theirs.

    Raises
    ------
    ArrayError
        With the meaning of the argument here.
    """
    if array.size and float(array.min()) < 0.0:
        raise ArrayError(
            f"'mask' holds the state where it is not 0, got numbers down to {array.min():g}: give "
            "an array of bool; of one of MatCNN, whose −1 stands for cells that are held, "
            "it is mask < 0."
        )


def _refusal(template: Template, role: str, got: str) -> ArrayError:
    return ArrayError(
        f"'{role}' of template '{template.name}' is a picture of numbers from −1 (white) to 1 "
        f"(black), got {got}: cnnum.as_picture makes one of pixels (True or level 0 is black)."
    )
