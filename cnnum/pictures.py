"""Pictures as a CNN takes them (+1 black, −1 white), from pixels and image files, and back."""

from __future__ import annotations  # signatures that `help` shows as they are written

import io
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats, finite
from cnnum.errors import ArrayError, PictureError, missing_extra, unreadable
from cnnum.safety.files import write_whole
from cnnum.safety.reading import open_regular
from cnnum.safety.values import as_path

WHITE = 255
"""White among 8-bit pixels; 0 is black."""

MOST_PIXELS = 1 << 26
"""Largest number of pixels in a picture file, more than any engine can run."""


LEAST_SIDE = 16
"""Rows and columns from which a last axis of 3 or 4 is taken for colours: arrays of sensors that
have 3 columns have fewer rows."""


def looks_coloured(shape: tuple[int, ...]) -> bool:
    """Return whether an array of a shape may be pictures of 3 or 4 channels, (rows, cols, 3)."""
    return len(shape) > 2 and shape[-1] in (3, 4) and min(shape[-3:-1]) >= LEAST_SIDE


def as_picture(pixels: ArrayLike) -> Floats:
    """Return pixels as a picture: +1 is black, −1 is white.

    Parameters
    ----------
    pixels : (..., rows, cols) bool or uint8
        True is black. Among 8-bit grey levels, 0 is black and 255 is white.

    Returns
    -------
    (..., rows, cols) float
        From −1 to 1.

    Raises
    ------
    ArrayError
        If the pixels have another type, do not form rows and columns, or have colours.
    """
    try:
        array = np.asarray(pixels)
    except ValueError:  # rows of different lengths
        array = np.zeros(0)
    if array.ndim < 2 or array.dtype not in (np.dtype(bool), np.dtype(np.uint8)):
        raise ArrayError(
            "A picture must consist of (..., rows, cols) pixels of type bool or uint8, got "
            f"the shape {array.shape} of type {array.dtype}; pass other pictures as numbers "
            "from −1 to 1."
        )
    if array.dtype == bool:
        return np.where(array, 1.0, -1.0)
    if looks_coloured(array.shape):
        raise ArrayError(
            "A picture must consist of (..., rows, cols) grey levels, got the shape "
            f"{array.shape}, whose last axis looks like colours: read the file with "
            "cnnum.load_picture, or take their mean, "
            "np.rint(pixels[..., :3].mean(axis=-1)).astype(np.uint8)."
        )
    return 1.0 - array * (2.0 / WHITE)


def as_pixels(picture: ArrayLike) -> NDArray[np.uint8]:
    """Return a picture as 8-bit grey levels: +1 becomes 0 (black), −1 becomes 255 (white).

    Parameters
    ----------
    picture : (..., rows, cols) float
        Beyond −1 and 1 it is black and white.

    Raises
    ------
    ArrayError
        If it holds NaN or infinity.
    """
    levels = (1.0 - np.clip(finite("picture", picture), -1.0, 1.0)) * (WHITE / 2.0)
    return np.rint(levels).astype(np.uint8)


def load_picture(path: str | Path) -> Floats:
    """Read an image file as a picture: +1 is black, −1 is white, grey and colours lie between.

    Parameters
    ----------
    path : str or Path
        Image in a format that Pillow reads (PNG, BMP, GIF, JPEG, TIFF…); transparency is white.

    Returns
    -------
    (rows, cols) float

    Raises
    ------
    PictureError
        If the file cannot be read, or is not an image.
    MissingExtraError
        If Pillow is not installed.
    """
    image = pillow("picture files")
    try:
        with open_regular(as_path(path, PictureError)) as held, image.open(held) as file:
            if file.width * file.height > MOST_PIXELS:
                raise PictureError(
                    f"'{path}' has more than {MOST_PIXELS} pixels: use a part of it."
                )
            colours = file.convert("RGBA")
        ground = image.new("RGBA", colours.size, "white")
        grey = image.alpha_composite(ground, colours).convert("L")
    except PictureError:
        raise
    except OSError as error:
        if error.errno is not None:
            raise unreadable(PictureError, f"'{path}'", error) from None
        why = "it is not an image that Pillow reads"
        raise PictureError(f"'{path}' cannot be read as a picture: {why}.") from None
    except (ValueError, SyntaxError, image.DecompressionBombError) as error:
        raise PictureError(f"'{path}' cannot be read as a picture: {error}.") from None
    return as_picture(np.array(grey, dtype=np.uint8))


def save_picture(
    picture: ArrayLike, path: str | Path, *, scale: int = 1, force: bool = False
) -> None:
    """Write a picture to an image file in the format of its suffix.

    Parameters
    ----------
    picture : (rows, cols) float
        +1 is black, −1 is white.
    path : str or Path
    scale : int
        Side length of a cell, in pixels.
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    ArrayError
        If the picture does not have two axes, or is not finite.
    PictureError
        If the file exists already or cannot be written, or the suffix is unknown.
    MissingExtraError
        If Pillow is not installed.
    """
    target, pixels = as_path(path, PictureError), as_pixels(picture)
    whole = isinstance(cast(object, scale), int | np.integer)
    if pixels.ndim != 2 or not pixels.size or not whole or scale < 1:
        raise ArrayError(
            "A picture file needs (rows, cols) pixels and a scale of at least 1, got "
            f"{pixels.shape} and {scale!r:.60}."
        )
    if pixels.size * int(scale) ** 2 > MOST_PIXELS:
        raise ArrayError(
            f"A picture file can have up to {MOST_PIXELS:,} pixels, got "
            f"{pixels.size * int(scale) ** 2:,}: use a smaller scale."
        )
    image, made = pillow("picture files"), io.BytesIO()
    kind = image.registered_extensions().get(target.suffix.lower())
    if kind is None:
        raise PictureError(
            f"'{path}' cannot be written as a picture: '{target.suffix}' is not a picture "
            "format; use .png."
        )
    try:
        image.fromarray(pixels.repeat(scale, axis=0).repeat(scale, axis=1)).save(made, kind)
    except (OSError, ValueError, KeyError) as error:
        raise PictureError(f"'{path}' cannot be written as a picture: {error}.") from None
    write_whole(target, made.getvalue(), error=PictureError, force=force)


def pillow(things: str, instead: str = "") -> Any:
    """Return Pillow's module of images.

    Parameters
    ----------
    things : str
        That need it, for the error.
    instead : str
        What does without it, in words.

    Raises
    ------
    MissingExtraError
        If Pillow is not installed.
    """
    try:
        return import_module("PIL.Image")
    except ImportError:
        raise missing_extra(things, "Pillow", "pictures", instead) from None
