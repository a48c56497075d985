"""A template of one's own, its state at times, and its answer as a picture file."""

import tempfile

import numpy as np

import cnnum

grow = cnnum.Template(
    name="grow",
    A=[[0.0, 0.5, 0.0], [0.5, 2.0, 0.5], [0.0, 0.5, 0.0]],
    z=2.7,
    boundary=-1.0,
    duration=4.0,
)
pixels = np.full((9, 9), 255, dtype=np.uint8)
pixels[4, 4] = 0  # black
result = cnnum.Engine("numba").run(grow, state=cnnum.as_picture(pixels), at=[0, 1, 2, 4])
black = [(output > 0).sum() for output in result.output]
print(result, black)
assert black[0] == 1
assert black == sorted(black)
assert black[-1] > 4
with tempfile.TemporaryDirectory() as folder:
    cnnum.save_picture(result.output[-1], f"{folder}/grown.png", scale=8)
