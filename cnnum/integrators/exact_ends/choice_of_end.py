"""Which transients end without time steps, and why."""

import math

from cnnum.graph.nodes import Transient
from cnnum.integrators.exact_ends.circulant import SHIFTS, circulant, shifts_fit
from cnnum.integrators.exact_ends.propagator import DENSE_LIMIT, decay, propagator
from cnnum.integrators.exact_ends.separate import separate
from cnnum.integrators.exact_ends.spectral import spectral
from cnnum.integrators.solver import Exact
from cnnum.templating.network import Network


def exact_end(transient: Transient, network: Network, duration: float) -> tuple[Exact | None, str]:
    """Return the end of a transient without steps, and why there is one, or why there is none.

    Parameters
    ----------
    transient : Transient
    network : Network
        Of its template.
    duration : float
        Infinite where it runs to equilibrium.
    """
    template = transient.template
    if template.output.limited or template.output.discrete:
        return None, "its state is limited, or runs in discrete time"
    if not template.plain:
        return None, "it has nonlinear, delayed or time-varying couplings"
    if not duration:
        return decay(template, 0.0), "it takes no time"
    if template.uncoupled:
        return decay(template, duration), "A = 0: every cell decays on its own, exactly"
    pieces = separate(template, duration)
    if pieces is not None:
        return pieces, "no cell sees another: its linear pieces are exact, one after the other"
    if not template.output.linear:
        return None, "its output saturates, so the array is not linear"
    if transient.has_mask:
        return None, "its fixed-state mask is only known at run time"
    modal = spectral(network, duration)
    if modal is not None:
        return modal, "the array is linear, and exact in the modes of its boundary"
    if network.states > DENSE_LIMIT:
        around = circulant(network) if math.isinf(duration) and shifts_fit(network) else None
        if around is not None:
            return around, SHIFTS
        return None, f"{network.states} states are more than the {DENSE_LIMIT} of a dense product"
    exact = propagator(network, duration)
    if exact is None:
        return None, "not every mode of the array decays, so it has no equilibrium"
    return exact, "the array is linear: one dense product is exact"
