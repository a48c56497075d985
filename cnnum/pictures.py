"""Pictures as a CNN takes them (+1 black, −1 white), from pixels and image files, and back."""

from __future__ import annotations  # signatures that `help` shows as they are written

import io
from collections.abc import Iterable
from fractions import Fraction
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cnnum.arrays import Floats, finite
from cnnum.errors import ArrayError, PictureError, missing_extra, name_error, unreadable
from cnnum.safety.files import write_whole, written
from cnnum.safety.reading import open_regular
from cnnum.safety.values import as_path, is_real

WHITE = 255
"""White among 8-bit pixels; 0 is black."""

MOST_PIXELS = 1 << 26
"""Largest number of pixels in a picture file, more than any engine can run."""

CODECS = {".mp4": "libx264", ".webm": "libvpx-vp9"}
"""Encoders of films that PyAV writes."""

FILMS = (".gif", *CODECS)


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


def save_film(
    pictures: ArrayLike,
    path: str | Path,
    *,
    rate: float = 10.0,
    scale: int = 1,
    force: bool = False,
) -> None:
    """Write pictures as a film: the times of a transient, or an output of a program frame by frame.

    Parameters
    ----------
    pictures : (times, rows, cols) float
        +1 is black, −1 is white.
    path : str or Path
        Ends in .gif, .mp4 (H.264) or .webm (VP9).
    rate : float, 1/s
        Pictures per second, up to 50, because viewers slow down faster .gif files.
    scale : int
        Side length of a cell, in pixels.
    force : bool
        Whether an existing file is replaced.

    Raises
    ------
    ArrayError
        If the pictures do not have three axes, or are not finite; if rate or scale is out of range.
    UnknownNameError
        If the suffix is another one.
    PictureError
        If the file exists already or cannot be written.
    MissingExtraError
        If Pillow, or PyAV for .mp4 and .webm, is not installed.
    """
    target, pixels = as_path(path, PictureError), as_pixels(pictures)
    suffix = film_kind(target)
    whole = isinstance(cast(object, scale), int | np.integer)
    if pixels.ndim != 3 or not pixels.size or not whole or scale < 1:
        raise ArrayError(
            "A film needs (times, rows, cols) pixels and a scale of at least 1, got "
            f"{pixels.shape} and {scale!r:.60}."
        )
    if pixels[0].size * int(scale) ** 2 > MOST_PIXELS:
        raise ArrayError(
            f"A film's pictures can have up to {MOST_PIXELS:,} pixels: use a smaller scale."
        )
    if not (is_real(rate) and 0.0 < rate <= FASTEST):
        raise ArrayError(
            f"A film has up to {FASTEST} pictures a second, got the rate {rate!r:.60}."
        )
    frames = (page.repeat(scale, axis=0).repeat(scale, axis=1) for page in pixels)
    with written(target, error=PictureError, force=force) as file:
        write_film(file, suffix, frames, float(rate))


FASTEST = 50
"""Pictures a second, at most: browsers slow down a .gif whose pictures last less than 20 ms."""


def film_kind(path: Path) -> str:
    """Return the suffix of a film's file in lower case, if such a film can be written here.

    Raises
    ------
    UnknownNameError
        If it is none.
    MissingExtraError
        If Pillow, or PyAV for .mp4 and .webm, is not installed.
    """
    suffix = path.suffix.lower()
    if suffix not in FILMS:
        raise name_error("kind of film", path.suffix or path.name, FILMS)
    if suffix not in CODECS:
        pillow("films as .gif")
    elif find_spec("av") is None:
        instead = "or write a .gif, which needs Pillow alone"
        raise missing_extra(f"films as {suffix}", "av", "film", instead)
    return suffix


def write_film(
    file: IO[bytes], suffix: str, frames: Iterable[NDArray[np.uint8]], rate: float
) -> None:
    """Write (rows, cols) grey levels or (rows, cols, 3) colours one after the other.

    `film_kind` says whether it can be done.
    """
    if suffix not in CODECS:
        image = pillow("films as .gif")
        first, *rest = (image.fromarray(frame) for frame in frames)
        lasts = round(1000.0 / rate)
        first.save(file, "GIF", save_all=True, append_images=rest, duration=lasts, loop=0)
        return
    av: Any = import_module("av")
    with av.open(file, "w", format=suffix[1:]) as container:
        stream = container.add_stream(CODECS[suffix], rate=Fraction(rate).limit_denominator(1000))
        stream.pix_fmt, stream.options = "yuv420p", {"crf": "18", "b": "0"}
        for number, frame in enumerate(frames):
            # colours are stored for two by two pixels
            even = [(0, side % 2) for side in frame.shape[:2]]
            shown = np.pad(frame, [*even, (0, 0)][: frame.ndim], mode="edge")
            if number == 0:
                stream.height, stream.width = shown.shape[:2]
            kind = "gray" if shown.ndim == 2 else "rgb24"
            container.mux(stream.encode(av.VideoFrame.from_ndarray(shown, format=kind)))
        container.mux(stream.encode())


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
