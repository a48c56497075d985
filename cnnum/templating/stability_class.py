"""The class of stability of a template, and the theorem that puts it there."""

from dataclasses import dataclass

import numpy as np

from cnnum.templating.reads import autonomous
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True)
class StabilityClass:
    """The class of a template's transients.

    Attributes
    ----------
    name : str
        "linear and stable", "bistable cells", "symmetric A", "feed-forward",
        "positive cell-linking" or "unknown".
    why : str
        A sentence.
    """

    name: str
    why: str


def stability_class(template: Template) -> StabilityClass:
    """Return the first class that a template belongs to, the plainest one first."""
    if template.output.discrete:
        return StabilityClass("unknown", "It runs in discrete time, in which cells may alternate.")
    if not autonomous(template):
        return StabilityClass("unknown", "No theorem here covers delays or gains in time.")
    if not all(coupling.static for coupling in template.nonlinear):
        return StabilityClass("unknown", "No theorem here covers couplings nonlinear in the state.")
    return (
        _contracting(template)
        or _unbounded(template)
        or _uncoupled(template)
        or _symmetric(template)
        or _feed_forward(template)
        or _positive(template)
        or StabilityClass(
            "unknown", "A is neither symmetric, nor feed-forward, nor linked by positive weights."
        )
    )


def _contracting(template: Template) -> StabilityClass | None:
    pull = np.abs(template.A).sum(axis=(1, 2, 3))
    if (pull >= 1.0).any():
        return None
    return StabilityClass(
        "linear and stable",
        f"The weights of A sum to {pull.max():.3g} in size, below 1, so that differences decay.",
    )


def _unbounded(template: Template) -> StabilityClass | None:
    """Theorems of rest need outputs that are bounded."""
    if not template.output.linear:
        return None
    return StabilityClass(
        "unknown", "Its output is linear: it rests if every mode decays, which its rates say."
    )


def _centre(template: Template) -> float:
    middle = template.A.shape[-1] // 2
    return float(template.A[0, 0, middle, middle])


def _uncoupled(template: Template) -> StabilityClass | None:
    middle = template.A.shape[-1] // 2
    others = template.A.copy()
    others[range(template.layers), range(template.layers), middle, middle] = 0.0
    if others.any() or template.layers > 1:
        return None
    own = _centre(template)
    kind = "bistable cells" if own > 1.0 else "monostable cells"
    beyond = "above 1: each ends black or white" if own > 1.0 else "at most 1: each has one end"
    return StabilityClass(kind, f"Cells act on themselves alone, with a00 = {own:g}, {beyond}.")


def _symmetric(template: Template) -> StabilityClass | None:
    mirrored = template.A.transpose(1, 0, 2, 3)[:, :, ::-1, ::-1]
    # a mirror at the rim keeps couplings symmetric only if they are even along each axis
    even = np.array_equal(template.A, template.A[:, :, ::-1])
    mirror = template.boundary.pad_mode == "symmetric"
    if not np.array_equal(template.A, mirrored) or (mirror and not even):
        return None
    return StabilityClass(
        "symmetric A", "A is symmetric, so that an energy falls until rest (Chua & Yang 1988)."
    )


def _feed_forward(template: Template) -> StabilityClass | None:
    if template.layers > 1:
        return None
    middle = template.A.shape[-1] // 2
    offsets = [tuple(place) for place in np.argwhere(template.A[0, 0]) - middle if place.any()]
    angles = np.sort([np.arctan2(down, east) for down, east in offsets])
    gaps = np.diff(np.append(angles, angles[0] + 2.0 * np.pi))
    if gaps.max() <= np.pi + 1e-9:
        return None
    return StabilityClass(
        "feed-forward",
        "All neighbours that act on a cell lie on one side of it, so that cells settle in turn.",
    )


def _positive(template: Template) -> StabilityClass | None:
    middle = template.A.shape[-1] // 2
    others = template.A[0, 0].copy()
    others[middle, middle] = 0.0
    if template.layers > 1 or (others < 0.0).any():
        return None
    return StabilityClass(
        "positive cell-linking",
        "No cell pushes another away, so that almost all transients settle (Chua & Roska 1990).",
    )
