"""decode(encode(strain)) is the strain, for any array that can be built."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cnnum.arrays import Floats
from cnnum.frame import FORCE_AXES
from cnnum.tactile.taxel import Bridge, Coupling, Heat, Readout, Taxel

small = st.floats(-0.2, 0.2)


@settings(max_examples=100, deadline=None)
@given(
    cross=arrays(np.float64, (2, 3, 3, 3), elements=small),
    offsets=arrays(np.float64, (2, 3, 4), elements=small),
    strain=arrays(np.float64, (4, 2, 3, 3), elements=st.floats(-1e-2, 1e-2)),
    transversal=st.floats(-5e9, 5e9),
    beta=st.floats(0.3, 5.0),
    wanted=st.permutations(FORCE_AXES).flatmap(lambda p: st.integers(1, 3).map(lambda n: p[:n])),
)
def test_strain_comes_back(
    cross: Floats,
    offsets: Floats,
    strain: Floats,
    transversal: float,
    beta: float,
    wanted: list[str],
) -> None:
    taxel = Taxel(
        Coupling.nominal(beta_ns=beta, cross=np.eye(3) + cross),
        Bridge(transversal=transversal),
        Readout(bits=None, limit=np.inf, offsets=offsets, heat=Heat(5e-3, 30.0)),
    )
    time = np.array([0.0, 10.0, 100.0, np.inf])
    volts = taxel.read(strain, time=time).volts
    calibration = taxel.calibration()
    found = calibration.to_strain(volts, wanted, time=time)
    chosen = [FORCE_AXES.index(name) for name in wanted]
    # Volts below 1, rounded, by α_s of at most 0.5 a volt and a cross of condition below 100.
    np.testing.assert_allclose(found, strain[..., chosen], atol=1e-13)
    quick = calibration.to_signals(volts, wanted) - calibration.to_signals(volts[:1], wanted)
    slow = calibration.to_signals(volts)[..., chosen]
    np.testing.assert_allclose(quick, slow - slow[:1], atol=1e-13)
