"""Linear arrays: filters, diffusion, interpolation and couplings that fade, mode by mode.

Linear arrays, exact at any time: each mode decays, grows or settles on its own.

x' = λx + b has the solution x(t) = e^{λt}x₀ + b(e^{λt} − 1)/λ (CNN: Chua & Yang 1988).

Diffusion that stops at steps, on dominoes: two cells that exchange, steps all around them.

Let d(v) = −r(1 − |v|/w) within |v| < w, and 0 beyond. The difference v of the two cells follows v'
= 2d(v)v, the logistic equation in |v|/w; their sum stays.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage, sparse
from scipy.sparse.linalg import spsolve

from cnnum.arrays import Floats, Shape
from cnnum.errors import TemplateError
from cnnum.templating.boundary import Boundary
from cnnum.templating.checks.pictures import gray, with_even
from cnnum.templating.checks.records import Case, ClosedForm, choice, number, text, time_constant
from cnnum.templating.template import Template

Operator = Callable[[Floats, Boundary], Floats]


def neighbours(
    picture: Floats, boundary: Boundary, radius: int = 1
) -> Callable[[int, int], Floats]:
    """Return a function of (row step, column step) that gives each cell that neighbour's value."""
    rows, cols = picture.shape[-2:]
    rim = [(0, 0)] * (picture.ndim - 2) + [(radius, radius)] * 2
    if boundary.constant is None:
        padded = np.pad(picture, rim, mode=boundary.pad_mode)
    else:
        padded = np.pad(picture, rim, constant_values=boundary.constant)

    def at(down: int, east: int) -> Floats:
        top, left = radius + down, radius + east
        return padded[..., top : top + rows, left : left + cols]

    return at


def _same(picture: Floats, boundary: Boundary) -> Floats:
    """Return the picture itself."""
    return picture


def _east(picture: Floats, boundary: Boundary) -> Floats:
    """Return the central difference along a row, towards rising columns."""
    at = neighbours(picture, boundary)
    return (at(0, 1) - at(0, -1)) / 2.0


def _south(picture: Floats, boundary: Boundary) -> Floats:
    """Return the central difference along a column, towards rising rows."""
    at = neighbours(picture, boundary)
    return (at(1, 0) - at(-1, 0)) / 2.0


def _slope_east(picture: Floats, boundary: Boundary) -> Floats:
    """Return a smoothed difference along a row, its rows weighed 0.11, 0.28 and 0.11."""
    at = neighbours(picture, boundary)
    rows = [at(down, 1) - at(down, -1) for down in (-1, 0, 1)]
    return 0.28 * rows[1] + 0.11 * (rows[0] + rows[2])


def _fall_east(picture: Floats, boundary: Boundary) -> Floats:
    """Return how far each cell lies above its neighbour to the east."""
    return picture - neighbours(picture, boundary)(0, 1)


def _between(picture: Floats, boundary: Boundary) -> Floats:
    """Return half the sum of the four sides less a quarter of that of the four corners."""
    at = neighbours(picture, boundary)
    sides = at(0, 1) + at(0, -1) + at(1, 0) + at(-1, 0)
    corners = at(1, 1) + at(1, -1) + at(-1, 1) + at(-1, -1)
    return sides / 2.0 - corners / 4.0


def _laplacian(picture: Floats, boundary: Boundary) -> Floats:
    at = neighbours(picture, boundary)
    return at(0, 1) + at(0, -1) + at(1, 0) + at(-1, 0) - 4.0 * picture


def _binomial(picture: Floats, boundary: Boundary) -> Floats:
    at = neighbours(picture, boundary)
    rows = [(at(-1, e) + 2.0 * at(0, e) + at(1, e)) / 4.0 for e in (-1, 0, 1)]
    return (rows[0] + 2.0 * rows[1] + rows[2]) / 4.0


def _divergence(field: Floats, boundary: Boundary) -> Floats:
    """Return ∂q_x/∂x + ∂q_y/∂y of (..., 2, rows, cols)."""
    return _east(field[..., 0, :, :], boundary) + _south(field[..., 1, :, :], boundary)


def _curl(field: Floats, boundary: Boundary) -> Floats:
    """Return ∂q_y/∂x − ∂q_x/∂y of (..., 2, rows, cols)."""
    return _east(field[..., 1, :, :], boundary) - _south(field[..., 0, :, :], boundary)


SCALAR: Mapping[str, Operator] = {
    "identity": _same,
    "gradient-x": _east,
    "slope-x": _slope_east,
    "gradient-y": _south,
    "fall-x": _fall_east,
    "between": _between,
    "laplacian": _laplacian,
    "binomial": _binomial,
}
"""Operators on one picture."""

VECTOR: Mapping[str, Operator] = {"divergence": _divergence, "curl": _curl}
"""Operators on a field of two components."""


@dataclass(frozen=True, slots=True, eq=False)
class Modes:
    """Modes of an array under every symmetric coupling.

    Attributes
    ----------
    apply : callable
        (array (..., rows, cols), factors (rows, cols)) to the array with each mode multiplied.
    cos_rows, cos_cols : (rows, 1) and (1, cols) float
        cos k of each mode, k the wave number in radians a cell.
    """

    apply: Callable[[Floats, Floats], Floats]
    cos_rows: Floats
    cos_cols: Floats

    def symbol(self, edge: float, corner: float = 0.0) -> Floats:
        """Return the eigenvalues of the sum over edge and corner neighbours, so weighed."""
        rows, cols = self.cos_rows, self.cos_cols
        return 2.0 * edge * (rows + cols) + 4.0 * corner * rows * cols

    @property
    def laplacian(self) -> Floats:
        """Eigenvalues of the five-point Laplacian; none is positive."""
        return self.symbol(1.0) - 4.0


def modes(boundary: Boundary, shape: Shape) -> Modes:
    """Return the modes of an array of that shape.

    Raises
    ------
    TemplateError
        If the boundary is a constant other than 0, which adds an inhomogeneous part.
    """
    if boundary.pad_mode == "symmetric":
        return _modes(_through_dct, shape, lambda n: np.pi * np.arange(n) / n)
    if boundary.pad_mode == "wrap":
        return _modes(_through_dft, shape, lambda n: 2.0 * np.pi * np.arange(n) / n)
    if boundary.constant == 0.0:
        # Sine modes vanish on the virtual cells 0 and n + 1; radius 1 only.
        return _modes(_through_dst, shape, lambda n: np.pi * np.arange(1, n + 1) / (n + 1))
    raise TemplateError(
        f"The modes of an array are known for the boundaries 0, 'zero-flux' and 'periodic', "
        f"got {boundary}."
    )


def _modes(
    apply: Callable[[Floats, Floats], Floats], shape: Shape, wave_numbers: Callable[[int], Floats]
) -> Modes:
    rows, cols = (np.cos(wave_numbers(n)) for n in shape)
    return Modes(apply, rows[:, np.newaxis], cols[np.newaxis, :])


def _through_dct(array: Floats, factors: Floats) -> Floats:
    spectrum = fft.dctn(array, type=2, axes=(-2, -1))
    return np.asarray(fft.idctn(spectrum * factors, type=2, axes=(-2, -1)), dtype=np.float64)


def _through_dst(array: Floats, factors: Floats) -> Floats:
    spectrum = fft.dstn(array, type=1, axes=(-2, -1))
    return np.asarray(fft.idstn(spectrum * factors, type=1, axes=(-2, -1)), dtype=np.float64)


def _through_dft(array: Floats, factors: Floats) -> Floats:
    spectrum = fft.fftn(array, axes=(-2, -1))
    return np.asarray(fft.ifftn(spectrum * factors, axes=(-2, -1)).real, dtype=np.float64)


ANALOG_TOLERANCE = 1e-3
ANALOG_REASON = (
    "ten times the relative tolerance 1e-4 of a run by default, as the errors of its steps add up; "
    "the answer itself is exact and of the order of 1"
)


def _diffusion_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    return Case(input=gray(rng, shape), duration=_time(template))


def _time(template: Template) -> float | None:
    time = number(template, "time", 0.0)
    return time * time_constant(template) if time > 0.0 else None


def _diffusion_rates(template: Template, modes: Modes) -> Floats:
    """Return λ of each mode where neighbours exchange, and nothing is made or lost."""
    edge, corner = number(template, "edge"), number(template, "corner", 0.0)
    return modes.symbol(edge, corner) - 4.0 * (edge + corner)


def _diffusion(template: Template, case: Case) -> Floats:
    return _homogeneous(template, case, lambda modes: _diffusion_rates(template, modes))


def _coupled_rates(template: Template, modes: Modes) -> Floats:
    edge, corner = number(template, "edge"), number(template, "corner", 0.0)
    return number(template, "centre") - 1.0 + modes.symbol(edge, corner)


def _coupled_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw gray values so small that the fastest mode keeps every cell within ±1."""
    time = number(template, "time")
    rates = _coupled_rates(template, modes(template.boundary, shape))
    # A sum of modes is bounded cell by cell by the norm of the propagator's rows.
    bound = np.exp(time * float(rates.max())) * np.sqrt(shape[0] * shape[1])
    return Case(input=gray(rng, shape, 0.95 / bound), duration=time * time_constant(template))


def _coupled(template: Template, case: Case) -> Floats:
    return _homogeneous(template, case, lambda modes: _coupled_rates(template, modes))


def _homogeneous(template: Template, case: Case, rates: Callable[[Modes], Floats]) -> Floats:
    start = np.asarray(case.start(template), dtype=np.float64)
    result = modes(template.boundary, (start.shape[-2], start.shape[-1]))
    return result.apply(start, np.exp(rates(result) * case.time(template)))


def _band_pass(template: Template, case: Case) -> Floats:
    """Solve x' = −(1 + s²K)²x + 4s²K u with K the wave number squared, on the lattice."""
    result = modes(template.boundary, (case.pictures.shape[-2], case.pictures.shape[-1]))
    scaled = -number(template, "scale") * result.laplacian
    rate = (1.0 + scaled) ** 2
    return result.apply(case.pictures, -np.expm1(-rate * case.time(template)) * 4.0 * scaled / rate)


def _form(
    name: str,
    cases: Callable[..., Case],
    expected: Callable[[Template, Case], Floats],
    summary: str,
    parameters: tuple[tuple[str, ...], tuple[str, ...]],
) -> ClosedForm:
    needs, takes = parameters
    return ClosedForm(
        name, cases, expected, ANALOG_TOLERANCE, ANALOG_REASON, summary, needs=needs, takes=takes
    )


LINEAR_FORMS = (
    _form(
        "diffusion",
        _diffusion_case,
        _diffusion,
        "heat exchange with the neighbours for a time, mode by mode",
        (("edge",), ("corner", "time")),
    ),
    _form(
        "coupled",
        _coupled_case,
        _coupled,
        "small signals of a symmetric feedback, mode by mode, before any cell saturates",
        (("centre", "edge", "time"), ("corner",)),
    ),
    _form(
        "band-pass",
        _diffusion_case,
        _band_pass,
        "4s²K/(1 + s²K)² of each mode: zero mean, gain 1 where s²K = 1",
        (("scale",), ("time",)),
    ),
)


def _filters_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    if text(template, "operator") in VECTOR:
        return Case(input=np.stack([gray(rng, shape), gray(rng, shape)], axis=1))
    return Case(input=gray(rng, shape))


def _filter(template: Template, case: Case) -> Floats:
    """Return w + (x₀ − w)e^{−t}, with w the operator's answer and t in time constants."""
    operator = choice(template, "operator", {**SCALAR, **VECTOR})
    gain = number(template, "gain", 1.0)
    goal = gain * operator(case.pictures, template.input_boundary)
    left = np.exp(-case.time(template))
    return np.asarray(goal + (case.start(template) - goal) * left, dtype=np.float64)


FILTERS_FORMS = (
    ClosedForm(
        "filter",
        _filters_case,
        _filter,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "w + (x0 - w)exp(-t) with w a named operator of the input",
        needs=("operator",),
        takes=("gain",),
    ),
)


def _gains_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    return Case(input=gray(rng, shape))


def _faded(template: Template, case: Case) -> Floats:
    """Solve x' = −x + g(t)Kx with g falling from 1 to 0 in a straight line: ln x is −t + K∫g."""
    result = modes(template.boundary, (case.pictures.shape[-2], case.pictures.shape[-1]))
    time, fade = case.time(template), number(template, "fade") / time_constant(template)
    seen = min(time, fade)
    coupled = result.symbol(number(template, "edge")) * (seen - 0.5 * seen**2 / fade)
    return result.apply(case.pictures, np.exp(coupled - time))


GAINS_FORMS = (
    ClosedForm(
        "fading",
        _gains_case,
        _faded,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "a coupling to the neighbours that fades in a straight line, mode by mode",
        needs=("edge", "fade"),
    ),
)


_STEP = 1.0
"""Between neighbouring dominoes; the differences inside them stay within 0.7 of it."""


def _dominoes(rng: np.random.Generator, rows: int, cols: int, width: float) -> Floats:
    """Return pictures of east-west dominoes, some of them with a difference above the width."""
    row, col = np.indices((rows, cols))
    level = np.where((row + col // 2) % 2, 0.5 * _STEP, -0.5 * _STEP)
    # near the width, errors would grow as e^{2rt}
    share = rng.uniform(0.05, 0.8, (3, rows, (cols + 1) // 2))
    share = np.where(rng.random(share.shape) < 0.2, 1.3, share) * rng.choice([-1, 1], share.shape)
    half = 0.5 * width * np.repeat(share, 2, axis=2)[:, :, :cols]
    return np.asarray(level + np.where(col % 2, half, -half), dtype=np.float64)


def _anisotropic_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    width = number(template, "width")
    flat = with_even(_dominoes(rng, shape[0], shape[1], width), 0.0)
    upright = _dominoes(rng, shape[1], shape[0], width).swapaxes(1, 2)
    return Case(input=np.concatenate([flat, upright]))


def _exchange(pictures: Floats, width: float, decay: float) -> Floats:
    """Return east-west dominoes once the odds |v|/(w − |v|) have decayed by that factor."""
    answer = pictures.copy()
    paired = 2 * (pictures.shape[-1] // 2)
    west, east = pictures[..., 0:paired:2], pictures[..., 1:paired:2]
    share = np.abs(east - west) / width
    kept = np.where(share < 1.0, decay / (1.0 - share + share * decay), 1.0)
    middle, half = 0.5 * (west + east), 0.5 * (east - west) * kept
    answer[..., 0:paired:2], answer[..., 1:paired:2] = middle - half, middle + half
    return answer


def _anisotropic_expected(template: Template, case: Case) -> Floats:
    width = number(template, "width")
    decay = float(np.exp(-2.0 * number(template, "rate") * case.time(template)))
    flat, upright = case.pictures[:4], case.pictures[4:].swapaxes(1, 2)
    answers = [_exchange(flat, width, decay), _exchange(upright, width, decay).swapaxes(1, 2)]
    return np.concatenate(answers)


ANISOTROPIC_FORMS = (
    ClosedForm(
        "dominoes",
        _anisotropic_case,
        _anisotropic_expected,
        ANALOG_TOLERANCE,
        ANALOG_REASON,
        "logistic decay of the difference of two cells that steps part from all others",
        needs=("width", "rate"),
    ),
)


_RIM = 2
_SHARE = 0.2


def _interpolation_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Hold a fifth of the cells of smooth pictures, start the others from 0; and nothing."""
    smooth = ndimage.gaussian_filter(rng.normal(size=(3, *shape)), (0.0, 1.5, 1.5))
    held = rng.random(smooth.shape) < _SHARE
    held[:, shape[0] // 2, shape[1] // 2] = True
    wanted = 0.4 * smooth / np.abs(smooth).max(axis=(-2, -1), keepdims=True)
    mask = np.concatenate([held, held[:1]]).astype(np.float64)
    return Case(input=with_even(np.where(held, wanted, 0.0), 0.0), mask=mask)


def bending(shape: Shape) -> sparse.csr_matrix:
    """Return the 13-point bi-Laplacian of an array with zeros beyond, cells row-major."""
    sides = [_second_difference(n + 2 * _RIM) for n in shape]
    laplacian = sparse.kronsum(sides[1], sides[0])
    inside = np.pad(np.ones(shape, dtype=bool), _RIM).ravel()
    return sparse.csr_matrix(laplacian @ laplacian)[inside][:, inside]


def _second_difference(cells: int) -> sparse.spmatrix:
    return sparse.diags([1.0, -2.0, 1.0], [-1, 0, 1], shape=(cells, cells), format="csr")


def _surface(matrix: sparse.csr_matrix, held: NDArray[np.bool_], values: Floats) -> Floats:
    surface = values.copy()
    if not held.all():
        free = ~held
        surface[free] = spsolve(
            matrix[free][:, free].tocsc(), -(matrix[free][:, held] @ values[held])
        )
    return surface


def _interpolation_expected(template: Template, case: Case) -> Floats:
    assert case.mask is not None
    shape = case.pictures.shape[-2], case.pictures.shape[-1]
    matrix = bending(shape)
    pairs = zip(case.mask.astype(bool), case.pictures, strict=True)
    surfaces = [_surface(matrix, held.ravel(), values.ravel()) for held, values in pairs]
    return np.stack([surface.reshape(shape) for surface in surfaces])


INTERPOLATION_FORMS = (
    ClosedForm(
        "interpolation",
        _interpolation_case,
        _interpolation_expected,
        1e-3,
        "a run settles where every rate is below 5e-5; the slowest mode decays at 0.9 or faster "
        "with a fifth of the cells held. So 144 rates add up to 7e-4 of its state",
        "the surface of least bending through the held cells, by a sparse linear system",
    ),
)

FORMS = (*LINEAR_FORMS, *FILTERS_FORMS, *GAINS_FORMS, *ANISOTROPIC_FORMS, *INTERPOLATION_FORMS)
