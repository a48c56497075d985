"""The numba engine compiles its transients once for each precision, for all arguments.

A form takes some twenty seconds to compile, so that one for each kind of boundary is felt.
"""

import numpy as np

from cnnum.engine import Engine
from cnnum.engines.numba.steps import drive_frames, run_frames
from cnnum.templating.couplings import DelayedCoupling, Gain, NonlinearCoupling
from cnnum.templating.functions import Table
from cnnum.templating.template import Template

ONE, RAMP = np.full((1, 1, 1, 1), 0.1), Table("linear", ((-1.0, 0.1), (2.0, 0.3)))
WEIGHTS = np.full((3, 3), 0.1)


def template(**more):
    return Template("any", WEIGHTS, [[1.0]], 0.1, initial=0.0, duration=0.3, **more)


PAIR = Template("pair", np.full((2, 2, 3, 3), 0.02), initial=0.1, duration=0.3)
CASES = [
    *((template(boundary=rim), {}) for rim in (0.0, 0.4, "zero-flux", "periodic")),
    *((template(boundary="zero-flux"), {"method": m}) for m in ("rk4", "etd-rk2")),
    (template(), {"method": "runge-kutta-chebyshev"}),
    (template(boundary="periodic", output="linear"), {}),  # solved by its modes
    (template(delayed=DelayedCoupling(0.1, ONE, ONE)), {}),
    (template(gains=[Gain(0, 0, RAMP)]), {}),
    (template(nonlinear=[NonlinearCoupling(WEIGHTS, RAMP, "x", "u")]), {}),
    (PAIR, {}),
]


def test_one_form_serves_all():
    rng = np.random.default_rng(0)
    for precision in ("float32", "float64"):
        engine = Engine("numba", precision=precision)
        for one, how in CASES:
            for batch in ((), (18,)):
                maps = {"mask": rng.random((*batch, 5, 6)) < 0.2} if batch else {}
                layers = (one.layers,) if one.layers > 1 else ()
                maps["state"] = rng.uniform(-1, 1, (*batch, *layers, 5, 6))
                if one.inputs:
                    maps["input"] = rng.uniform(-1, 1, (*batch, 5, 6))
                if one.delayed is not None:
                    maps["previous"] = maps["input"]
                engine.run(one, **how, **maps)
    for function in (run_frames, drive_frames):
        assert len(function.signatures) == 2
