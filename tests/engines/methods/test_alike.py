"""Cells that are alike stay so, though an array lets the least difference between them grow far.

Start and template have a symmetry under shifts of the array, with or without a change of sign. The
pattern is one mode of a periodic array that stays where its output is linear, so that it decays as
e^{(λ − 1) t}. Others grow by up to e^{75}: one rounding that tells cells apart would fill the
array.
"""

import math

import numpy as np
import pytest

import cnnum

METHODS = (None, "bogacki-shampine", "dormand-prince", "rk4", "heun")


def drawn(seed):
    """Return a kernel, a pattern that it keeps, the pattern's λ, and a time."""
    rng = np.random.default_rng([5, seed])
    size = int(rng.choice([3, 5]))
    i, j = np.indices((2 * int(rng.integers(1, 4)), 4 * int(rng.integers(1, 3))))
    down, right = np.indices((size, size)) - size // 2
    kind = seed % 3
    if kind == 0:
        pattern, seen = np.ones(i.shape), np.ones((size, size))
    elif kind == 1:
        pattern, seen = (-1.0) ** (i + j), (-1.0) ** (down + right)
    else:  # stripes two cells wide; even kernels see no other of their phases
        pattern = np.where(j % 4 < 2, 1.0, -1.0)
        seen = np.array([1.0, 0.0, -1.0, 0.0])[right % 4]
    kernel = rng.normal(size=(size, size))
    kernel += kernel[:, ::-1]
    rows, cols = i.shape
    modes = [
        (kernel * np.cos(2 * np.pi * (down * a / rows + right * b / cols))).sum()
        for a in range(rows)
        for b in range(cols)
    ]
    time, decay = float(rng.uniform(3.0, 12.0)), float(rng.uniform(-1.0, 0.9))
    kernel *= rng.uniform(30.0, 60.0) / time / max(modes)
    kernel[size // 2, size // 2] += decay - (kernel * seen).sum()
    return kernel, pattern * rng.uniform(0.05, 0.9), math.fsum((kernel * seen).ravel()), time


@pytest.mark.parametrize(
    ("name", "precision"),
    [
        ("reference", "float64"),
        ("numba", "float64"),
        ("numba", "float32"),
        ("opencl", "float64"),
        ("opencl", "float32"),
    ],
)
def test_patterns_that_decay_are_kept_among_modes_that_grow(name, precision):
    engine = cnnum.Engine(name, precision=precision)
    for seed in range(15 if name == "reference" else 4):
        kernel, start, decay, time = drawn(seed)
        template = cnnum.Template("alike", kernel, boundary="periodic", duration=time)
        end = start * math.exp((decay - 1.0) * time)
        for method in METHODS:
            how = {} if method is None else {"method": method, "estimate": True}
            result = engine.run(template, state=start, **how)
            off = np.abs(np.asarray(result.state, np.float64) - end).max()
            assert off <= result.error < 0.01, (seed, method)


def test_implicit_steps_say_where_they_tell_cells_apart():
    """Sparse solves add in an order of their own, so that the least difference fills the array."""
    engine = cnnum.Engine("numba", precision="float64")
    for seed in (0, 17):
        kernel, start, decay, time = drawn(seed)
        template = cnnum.Template("alike", kernel, boundary="periodic", duration=time)
        result = engine.run(template, state=start, method="rodas3")
        off = np.abs(result.state - start * math.exp((decay - 1.0) * time)).max()
        assert off <= result.error
