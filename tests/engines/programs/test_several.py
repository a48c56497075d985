"""Sums, means, lengths and the largest of several fields."""

import numpy as np

import cnnum
from cnnum.programs.fields import length, mean, most, total


def test_several_fields_are_what_numpy_says(fast):
    names = ("a", "b", "c")

    @cnnum.program
    def joined(frame):
        fields = [frame.channel(name) for name in names]
        _, number, twice = most(
            [
                (field.max(), float(n) + 0.0 * field.sum(), 2.0 * field)
                for n, field in enumerate(fields)
            ]
        )
        return {
            "total": total(fields),
            "mean": mean(fields),
            "length": length(fields),
            "most": number,
            "twice": twice,
        }

    maps = np.random.default_rng(2).integers(-9, 10, (30, 2, 2, 3)).astype(float)
    maps[0] = 1.0  # of equal ones the first
    got = fast.compile(joined, (2, 2), channels=names)(maps)
    np.testing.assert_array_equal(got["total"], maps.sum(axis=-1))
    # rounding of single precision, on numbers up to 16
    np.testing.assert_allclose(got["mean"], maps.mean(axis=-1), atol=1e-5)
    np.testing.assert_allclose(got["length"], np.linalg.norm(maps, axis=-1), atol=1e-5)
    best = maps.max(axis=(1, 2)).argmax(axis=-1)
    assert len(set(best)) == 3
    np.testing.assert_array_equal(got["most"], best)
    np.testing.assert_array_equal(
        got["twice"], [2 * m[..., n] for m, n in zip(maps, best, strict=True)]
    )
