"""Time to the answer: whole runs of templates against the functions that a user would take instead.

Each side gets a picture in the form that it takes (arrays of float32 here, bool or bytes there),
and gives a picture; what is counted is the call, from array to array. Both pictures are compared.
"""

import importlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from threading import Thread
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from cnnum.arrays import Floats
from cnnum.engine import Engine
from cnnum.engines.numba.compiling import most_cores
from cnnum.errors import MissingExtraError, missing_extra
from cnnum.integrators.schemes import DECISION
from cnnum.lab.bench.timing import interleaved
from cnnum.programs.library import program_names

CROSS = ndimage.generate_binary_structure(2, 1)
SQUARE = ndimage.generate_binary_structure(2, 2)
LAPLACE = np.array([[-1.0, -1.0, -1.0], [-1.0, 8.0, -1.0], [-1.0, -1.0, -1.0]], np.float32)
"""EDGE's B; a black cell with a white neighbour is above 1."""

Blacks = NDArray[np.bool_]
Prepare = Callable[[Blacks, Blacks], Callable[[], Any]]
"""Brings black cells and marks into a library's form, and returns the call that answers."""


@dataclass(frozen=True, slots=True)
class Answer:
    """A row of `cnnum bench answers`.

    Attributes
    ----------
    case, peer, device : str
    method : str
        Method of the engine.
    peer_seconds, seconds : float
        Medians of calls in turns, array to array, s.
    ratio : float
        Theirs over ours: above 1 the engine is ahead.
    spread : float
        Spread of our time, s.
    wrong : int
        Cells in which the two pictures differ.
    memory_share : float or None
        Of an output in one pass: time to move the same bytes alone, in turns with it, over ours.
    """

    case: str
    peer: str
    device: str
    method: str
    peer_seconds: float
    seconds: float
    ratio: float
    spread: float
    wrong: int
    memory_share: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A template on pictures of a shape, and who else gives the answer.

    Attributes
    ----------
    template : str
        Its name, or that of a program of pictures.
    shape : tuple of int
        (..., rows, cols) of the picture.
    peers : mapping of str to callable
        Each prepares its own form of the pictures, and returns the call that gives the answer.
    gray : bool
        Whether the picture is gray, and so is the answer.
    others : tuple of str
        Peers that solve the task by another rule, so that some cells differ.
    """

    template: str
    shape: tuple[int, ...]
    peers: Mapping[str, Prepare]
    gray: bool = False
    others: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The case in words."""
        rows, cols = self.shape[-2:]
        many = f"{self.shape[0]:,} of " if len(self.shape) == 3 else ""
        return f"{self.template}, {many}{rows}×{cols}"


def _frames(work: Callable[[Any], Any], pictures: NDArray[Any]) -> Callable[[], Any]:
    if pictures.ndim == 2:
        return lambda: work(pictures)
    return lambda: np.stack([work(picture) for picture in pictures])


def _opencv_edge(black: Blacks, _: Blacks) -> Callable[[], Any]:
    cv2 = _opencv()

    def edge(picture: Floats) -> Any:
        result = cv2.filter2D(picture, -1, LAPLACE, borderType=cv2.BORDER_REPLICATE)
        return cv2.threshold(result, 1.0, 1.0, cv2.THRESH_BINARY)[1]

    return _frames(edge, np.where(black, np.float32(1.0), np.float32(-1.0)))


def _opencv() -> Any:
    try:
        return importlib.import_module("cv2")
    except ImportError:
        raise missing_extra("the peer OpenCV", "opencv-python-headless", "peers") from None


def _scipy_edge(black: Blacks, _: Blacks) -> Callable[[], Any]:
    def edge(picture: Floats) -> Any:
        return ndimage.correlate(picture, LAPLACE, mode="nearest") > 1.0

    return _frames(edge, np.where(black, np.float32(1.0), np.float32(-1.0)))


def _scipy_holes(black: Blacks, _: Blacks) -> Callable[[], Any]:
    return _frames(partial(ndimage.binary_fill_holes, structure=CROSS), black)


def _scipy_recall(black: Blacks, marks: Blacks) -> Callable[[], Any]:
    return lambda: ndimage.binary_propagation(marks, SQUARE, mask=black)


def _scipy_unmarked(black: Blacks, marks: Blacks) -> Callable[[], Any]:
    return lambda: black & ~ndimage.binary_propagation(marks, CROSS, mask=black)


def _scipy_erosion(black: Blacks, _: Blacks) -> Callable[[], Any]:
    return partial(ndimage.binary_erosion, black, CROSS)


def _scipy_dilation(black: Blacks, _: Blacks) -> Callable[[], Any]:
    return partial(ndimage.binary_dilation, black, CROSS)


def _opencv_median(picture: Any, _: Blacks) -> Callable[[], Any]:
    return partial(_opencv().medianBlur, picture, 3)


def _scipy_median(picture: Any, _: Blacks) -> Callable[[], Any]:
    return partial(ndimage.median_filter, picture, 3, mode="nearest")


def _scipy_maximum(picture: Any, _: Blacks) -> Callable[[], Any]:
    return partial(ndimage.maximum_filter, picture, 3, mode="nearest")


def _opencv_maximum(picture: Any, _: Blacks) -> Callable[[], Any]:
    return partial(_opencv().dilate, picture, np.ones((3, 3), np.uint8))


def _skimage(module: str) -> Any:
    try:
        return importlib.import_module(f"skimage.{module}")
    except ImportError:
        raise missing_extra("the peer scikit-image", "scikit-image", "race") from None


def _skimage_edge(black: Blacks, _: Blacks) -> Callable[[], Any]:
    find = _skimage("segmentation").find_boundaries
    return _frames(partial(find, connectivity=2, mode="inner"), black)


def _skimage_holes(black: Blacks, _: Blacks) -> Callable[[], Any]:
    fill = _skimage("morphology").reconstruction

    def holes(picture: Blacks) -> Any:
        seed = picture.copy()
        seed[1:-1, 1:-1] = True
        return fill(seed, picture, method="erosion", footprint=CROSS)

    return _frames(holes, black)


def _skimage_recall(black: Blacks, marks: Blacks) -> Callable[[], Any]:
    return partial(_skimage("morphology").reconstruction, marks, black, footprint=SQUARE)


def _skimage_unmarked(black: Blacks, marks: Blacks) -> Callable[[], Any]:
    fill = _skimage("morphology").reconstruction
    return lambda: black & (fill(marks, black, footprint=CROSS) == 0.0)


def _skimage_erosion(black: Blacks, _: Blacks) -> Callable[[], Any]:
    return partial(_skimage("morphology").erosion, black, CROSS, mode="min")


def _skimage_dilation(black: Blacks, _: Blacks) -> Callable[[], Any]:
    return partial(_skimage("morphology").dilation, black, CROSS, mode="min")


def _skimage_median(picture: Any, _: Blacks) -> Callable[[], Any]:
    return partial(_skimage("filters").median, picture, SQUARE, mode="nearest")


def _skimage_maximum(picture: Any, _: Blacks) -> Callable[[], Any]:
    return partial(_skimage("morphology").dilation, picture, SQUARE)


PEELED = (("oo./o##/.#.",), ("ooo/.#./##.", "ooo/.#./.##"))
"""What SKELBW1 and SKELBW2 remove: black cells (#) in a corner of an object or on its side, beside
white ones (o). The other six are these by quarter turns."""


def _scipy_skeleton(black: Blacks, _: Blacks) -> Callable[[], Any]:
    signs = [[np.array([list(row) for row in one.split("/")]) for one in some] for some in PEELED]
    patterns = [[np.rot90(sign, -turn) for sign in some] for turn in range(4) for some in signs]
    pairs = [[(pattern == "#", pattern == "o") for pattern in some] for some in patterns]

    def skeleton() -> Blacks:
        left = np.pad(black, 1)  # with white: SciPy's outside is neither black nor white
        before = np.zeros_like(left)
        while (left != before).any():
            before = left
            for some in pairs:
                hits = [ndimage.binary_hit_or_miss(left, kept, away) for kept, away in some]
                left = left & ~np.logical_or.reduce(hits)
        return left[1:-1, 1:-1]

    return skeleton


def _skimage_thin(black: Blacks, _: Blacks) -> Callable[[], Any]:
    return partial(_skimage("morphology").thin, black)


def _skimage_skeleton(black: Blacks, _: Blacks) -> Callable[[], Any]:
    return partial(_skimage("morphology").skeletonize, black)


STEP = 0.01
"""By which the table of the library's MEDIAN shifts its answer."""

MEDIANS: Mapping[str, Prepare] = {
    "OpenCV": _opencv_median,
    "SciPy": _scipy_median,
    "scikit-image": _skimage_median,
}
MAXIMA: Mapping[str, Prepare] = {
    "OpenCV": _opencv_maximum,
    "SciPy": _scipy_maximum,
    "scikit-image": _skimage_maximum,
}
EDGES: Mapping[str, Prepare] = {
    "OpenCV": _opencv_edge,
    "SciPy": _scipy_edge,
    "scikit-image": _skimage_edge,
}
HOLES: Mapping[str, Prepare] = {"SciPy": _scipy_holes, "scikit-image": _skimage_holes}
RECALL: Mapping[str, Prepare] = {"SciPy": _scipy_recall, "scikit-image": _skimage_recall}
ERODED: Mapping[str, Prepare] = {"SciPy": _scipy_erosion, "scikit-image": _skimage_erosion}
DILATED: Mapping[str, Prepare] = {"SciPy": _scipy_dilation, "scikit-image": _skimage_dilation}
UNMARKED: Mapping[str, Prepare] = {"SciPy": _scipy_unmarked, "scikit-image": _skimage_unmarked}

SKELETONS: Mapping[str, Prepare] = {
    "SciPy": _scipy_skeleton,
    "scikit-image thin": _skimage_thin,
    "scikit-image skeletonize": _skimage_skeleton,
}
BY_OTHER_RULES = ("scikit-image thin", "scikit-image skeletonize")

CASES = (
    Case("EDGE", (1000, 64, 64), EDGES),
    Case("EDGE", (1024, 1024), EDGES),
    *(Case("HOLE", (size, size), HOLES) for size in (64, 256, 1024)),
    *(Case("RECALL", (size, size), RECALL) for size in (64, 256, 1024)),
    *(Case("CONNECTI", (size, size), UNMARKED) for size in (64, 256, 1024)),
    Case("CHUA_EROSION", (1024, 1024), ERODED),
    Case("CHUA_DILATION", (1024, 1024), DILATED),
    *(Case("MEDIAN", (size, size), MEDIANS, gray=True) for size in (256, 1024)),
    Case("MAX", (256, 256), MAXIMA, gray=True),
    *(Case("skeleton", (size, size), SKELETONS, others=BY_OTHER_RULES) for size in (64, 256, 1024)),
)

COUNT = sum(len(case.peers) for case in CASES)
"""Rows, where nothing is missing."""


def measure_answers(engine: Engine, *, quick: bool = False) -> Iterator[Answer | str]:
    """Yield a row for each case and peer, or a sentence where a peer is missing or left out."""
    for case in CASES:
        for peer, prepare in case.peers.items():
            if quick and int(np.prod(case.shape)) > 100_000:
                yield f"{case.name}: takes seconds, left out by --quick"
                continue
            try:
                yield measure(engine, case, peer, prepare, 0.2 if quick else 3.0)
            except MissingExtraError as error:
                yield str(error)


def pictures(case: Case) -> tuple[Blacks, Blacks]:
    """Return the black cells of random blobs, half of all cells, and marks in one of a hundred."""
    rng = np.random.default_rng(11)
    noise = rng.normal(size=case.shape)
    black = np.asarray(ndimage.gaussian_filter(noise, (0, 1, 1)[-len(case.shape) :]) > 0.0)
    return black, black & (rng.random(case.shape) < 0.01)


def measure(
    engine: Engine,
    case: Case,
    peer: str,
    prepare: Prepare,
    budget: float,
) -> Answer:
    """Return the row of a case and a peer.

    Parameters
    ----------
    engine : Engine
    case : Case
    peer : str
    prepare : callable
        Of the peer.
    budget : float
        s for the turns of both.
    """
    black, marks = pictures(case)
    picture: Any = np.where(black, np.float32(1.0), np.float32(-1.0))
    if case.gray:
        picture = np.random.default_rng(12).uniform(-1.0, 1.0, case.shape).astype(np.float32)
    theirs = prepare(picture if case.gray else black, marks)
    maps: dict[str, Any] = {"input": picture}
    if case.template in ("RECALL", "CONNECTI"):
        begun = marks if case.template == "RECALL" else black & ~marks
        maps["state"] = np.where(begun, np.float32(1.0), np.float32(-1.0))
    ours, output, method = _own(engine, case, maps)
    if case.gray:
        wrong = int((np.abs(output - theirs()) > STEP + 1e-6).sum())
    else:
        wrong = int(((output > 0.0) != (np.asarray(theirs()) > 0)).sum())
    calls: list[Callable[[], object]] = [theirs, ours]
    if method == DECISION:
        calls.append(moving(picture))
    peer_time, own, *moved = interleaved(calls, budget=budget, runs=31)
    return Answer(
        case=case.name,
        peer=peer,
        device=engine.device,
        method=method,
        peer_seconds=peer_time.median,
        seconds=own.median,
        ratio=peer_time.median / own.median,
        spread=own.spread,
        wrong=wrong,
        memory_share=moved[0].median / own.median if moved else None,
    )


def _own(
    engine: Engine, case: Case, maps: Mapping[str, Any]
) -> tuple[Callable[[], object], NDArray[Any], str]:
    """Return our call, what it gives, and its method."""
    if case.template in program_names("pictures"):
        plan = engine.compile(case.template, case.shape, channels=("picture",))
        frame = maps["input"][..., np.newaxis]
        return partial(plan, frame), np.asarray(plan(frame)["picture"]), "program"
    result = engine.run(case.template, **maps)
    return partial(engine.run, case.template, **maps), result.output, result.method


def moving(picture: NDArray[Any]) -> Callable[[], None]:
    """Return a call that moves what one pass moves on all cores: a picture, its copy, an output."""
    source, kept, output = (
        picture.ravel(),
        np.empty(picture.size, picture.dtype),
        np.empty(picture.size),
    )
    count = most_cores()
    shares = [slice(source.size * n // count, source.size * (n + 1) // count) for n in range(count)]

    def move(share: slice) -> None:
        kept[share] = source[share]
        output[share] = 1.0

    def call() -> None:
        threads = [Thread(target=move, args=(share,)) for share in shares[1:]]
        for thread in threads:
            thread.start()
        move(shares[0])
        for thread in threads:
            thread.join()

    return call
