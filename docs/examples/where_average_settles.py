"""A sweep that finds where AVERAGE stops settling: one neighbour's weight against the own one."""

import numpy as np

from cnnum.design import sweep
from cnnum.design.experiment import Experiment

axes = {
    "A[1, 1]": (0.0, 1.0, 1.5, 2.0, 3.0),  # the own feedback; the library has 2
    "A[0, 1]": (-8.0, -6.0, -4.0, -3.0, -2.0, -1.0, 0.0, 1.0),  # of the north; the library has 1
}
experiment = Experiment("AVERAGE", axes=axes, duration=60.0, engine="numba")
settled = sweep(experiment).results["settled"].isel(draw=0)
print(settled.to_pandas().to_string())

least = settled.min("A[0, 1]")
print("settles at every weight of the north:", least["A[1, 1]"].values[least.values == 1.0])
# symmetric weights always settle (Chua and Yang 1988); the library's numbers are such
assert float(settled.sel({"A[1, 1]": 2.0, "A[0, 1]": 1.0})) == 1.0
assert np.isfinite(settled).all()
assert float(settled.min()) < 1.0
