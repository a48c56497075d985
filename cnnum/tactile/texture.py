"""Friction and roughness of a surface that slides over a bump (dissertation 6.5)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.errors import ArrayError, PhysicsError
from cnnum.tactile import checks
from cnnum.tactile.checks import Array

WINDOW = 128
"""T of the dissertation: 128 frames of 15 ms, about two seconds."""
_BLOCK = 1 << 20  # numbers worked on at once: every window overlaps its neighbours


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """Friction and roughness over the last frames.

    Attributes
    ----------
    friction : (...) float
        Mean of |T_shear|/|S_n|, (6.3); 0 where not valid.
    roughness : (...) float
        100 times its standard deviation divided by its mean, (6.4); 0 where not valid.
    count : (...) int
        Number of points of the window that are in contact.
    valid : (...) bool
        Whether there were two points or more, and some friction.

    References
    ----------
    Vásárhelyi 2007, (6.3), (6.4). The mean is over all T + 1 points from t − T to t (the printed
    formula has a sum). The deviation is the unbiased estimate (division by one less
    than the number of points).
    """

    friction: Array
    roughness: Array
    count: NDArray[np.intp]
    valid: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class TextureState:
    """The last frames, for `stream`: passed in and returned, never modified.

    Attributes
    ----------
    ratios : (frames, ...) float
        Friction of each frame, oldest first, at most T + 1 of them.
    touching : (frames, ...) bool
        Where that friction counts.
    window : int
        T.
    threshold : float
        Smallest |S_n| of a contact.
    """

    ratios: Array
    touching: NDArray[np.bool_]
    window: int
    threshold: float


def texture(signals: ArrayLike, *, window: int = WINDOW, threshold: float = 0.0) -> Texture:
    """Return friction and roughness at each frame of a recording.

    Parameters
    ----------
    signals : (frames, ..., 3) float
        T_x, T_y and S_n of one taxel or of an array, of any unit; time runs along the first axis.
    window : int
        T: the last T + 1 frames count, or fewer at the start.
    threshold : float
        A frame counts where |S_n| is above this; otherwise, there is no contact.

    Returns
    -------
    Texture
        Results with the shape (frames, ...).

    Raises
    ------
    ArrayError
        If the axes are wrong.
    PhysicsError
        If the window or threshold is out of range, or a value is not finite.
    """
    state = start(window=window, threshold=threshold)
    rows = checks.vector("signals", signals)
    if rows.ndim < 2:
        raise ArrayError(
            f"'signals' must have the shape (frames, ..., 3), got {rows.shape}; use `stream` for "
            "one frame at a time."
        )
    ratios, touching = _friction(rows, state.threshold)
    lead = np.zeros((window, *ratios.shape[1:]))
    padded = np.concatenate([lead, ratios])
    mask = np.concatenate([lead > 0.0, touching])
    view = np.lib.stride_tricks.sliding_window_view
    windows, marks = view(padded, window + 1, axis=0), view(mask, window + 1, axis=0)
    step = max(1, _BLOCK // max(1, windows[:1].size))
    cuts = [slice(k, k + step) for k in range(0, max(1, len(ratios)), step)]
    return _joined([_statistics(windows[cut], marks[cut]) for cut in cuts])


def start(*, window: int = WINDOW, threshold: float = 0.0) -> TextureState:
    """Return the state before the first frame.

    Parameters
    ----------
    window, threshold
        As in `texture`.

    Raises
    ------
    PhysicsError
        If the window is below 1 or the threshold negative.
    """
    if window < 1:
        raise PhysicsError(f"'window' must be 1 frame or more, got {window}.")
    limit = checks.scalar("threshold", checks.not_negative("threshold", threshold))
    return TextureState(np.zeros((0,)), np.zeros((0,), dtype=np.bool_), window, limit)


def stream(state: TextureState, signals: ArrayLike) -> tuple[TextureState, Texture]:
    """Return the state after one more frame, and the texture at it.

    Parameters
    ----------
    state : TextureState
        From `start` or the previous call.
    signals : (..., 3) float
        T_x, T_y, S_n of one frame.

    Returns
    -------
    TextureState
    Texture
        The same numbers as `texture` gives for that frame.

    Raises
    ------
    ArrayError
        If the frame does not have the shape of the previous ones.
    PhysicsError
        If a value is not finite.
    """
    ratio, touching = _friction(checks.vector("signals", signals), state.threshold)
    past, known = state.ratios, state.touching
    if past.size == 0 and past.ndim == 1:
        past = np.zeros((state.window + 1, *ratio.shape))
        known = np.zeros(past.shape, dtype=np.bool_)
    if past.shape[1:] != ratio.shape:
        raise ArrayError(
            f"'signals' must keep the shape {(*past.shape[1:], 3)} of the previous frames, got "
            f"{(*ratio.shape, 3)}; use a new stream for another array."
        )
    ratios = np.concatenate([past[1:], ratio[np.newaxis]])
    mask = np.concatenate([known[1:], touching[np.newaxis]])
    after = TextureState(ratios, mask, state.window, state.threshold)
    return after, _statistics(np.moveaxis(ratios, 0, -1), np.moveaxis(mask, 0, -1))


def _joined(parts: list[Texture]) -> Texture:
    """Return the textures of consecutive frames as one."""
    return Texture(
        np.concatenate([part.friction for part in parts]),
        np.concatenate([part.roughness for part in parts]),
        np.concatenate([part.count for part in parts]),
        np.concatenate([part.valid for part in parts]),
    )


def _friction(signals: Array, threshold: float) -> tuple[Array, NDArray[np.bool_]]:
    """Return |T_shear|/|S_n| where in contact, 0 elsewhere, and where that is."""
    normal = np.abs(signals[..., 2])
    touching = np.asarray(normal > threshold)
    shear = np.hypot(signals[..., 0], signals[..., 1])
    ratio = np.divide(shear, normal, out=np.zeros_like(shear), where=touching)
    return ratio, touching


def _statistics(ratios: Array, touching: NDArray[np.bool_]) -> Texture:
    """Return mean and relative deviation over the last axis, of the cells in contact."""
    count = np.count_nonzero(touching, axis=-1)
    mean = np.sum(ratios, axis=-1) / np.maximum(count, 1)
    gaps = np.where(touching, ratios - mean[..., np.newaxis], 0.0)
    deviation = np.sqrt(np.sum(gaps**2, axis=-1) / np.maximum(count - 1, 1))
    valid = np.asarray((count >= 2) & (mean > 0.0))
    roughness = np.divide(100.0 * deviation, mean, out=np.zeros_like(mean), where=valid)
    return Texture(np.where(valid, mean, 0.0), roughness, np.asarray(count, dtype=np.intp), valid)
