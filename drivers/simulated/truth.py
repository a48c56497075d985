"""The ground truth of a simulated scan."""

from math import atan2, hypot

from cnnum.drivers.simulated.bodies import Brush
from cnnum.drivers.simulated.springs import Springs, State
from cnnum.frame import Truth

INCIPIENT = 0.5
"""Slip is called incipient when the stick radius is below this share of the contact radius; of a
force that only grows that is Q > 7/8 μP."""

SLIP_SPEED = 0.1e-3
"""m/s: below it a movement over the cover is creep, not slip."""

SLIP_SHARE = 0.5
"""Share of μP that the shear force has at least in gross slip. Sliding alone has all of it. A
turning or vanishing contact that lets a locked-in deflection go moves with less."""


def truth_of(
    springs: Springs | Brush, state: State, turned: float, turn: float, rate: float
) -> Truth:
    """Return the ground truth of a scan.

    Parameters
    ----------
    springs : Springs or Brush
    state : State
    turned : float, rad
        How far the sphere has turned about the normal since it touched.
    turn : float, rad
        Of this since the scan before.
    rate : float, Hz

    Returns
    -------
    Truth
        "contact", "incipient" (the stick radius is below half the contact's under a shear force,
        and nothing slides yet), "slip" (gross slip over the cover), "twist_slip" (the same stick
        radius under a torque, while turning): 0 or 1; "contact_radius", "stick_radius", "x", "y"
        (m); "slip_speed" (m/s), "slip_direction" (rad, 0 without slip); "twist" (rad),
        "twist_rate" (rad/s); "normal_force", "shear_x", "shear_y" (N), "torque" (N m); "friction"
        of the pair. Radii of flat faces are those of circles with the area that touches and that
        sticks. Of two fingers the other one's are "other_shear_x", "other_shear_y" and
        "other_torque", in its own axes.
    """
    shear_x, shear_y = springs.force(state).tolist()
    torque = springs.torque(state)
    a, c = state.contact_radius, state.stick_radius
    speed = hypot(*state.slipped.tolist()) * rate
    force = hypot(shear_x, shear_y)
    slips = speed > SLIP_SPEED and force > SLIP_SHARE * springs.pair.friction * state.load
    loose = a > 0 and c < INCIPIENT * a
    sheared = force * a > abs(torque)
    other: dict[str, float] = {}
    if state.facing is not None:
        along, across = springs.force(state.facing).tolist()
        other = {"other_shear_x": along, "other_shear_y": across}
        other["other_torque"] = springs.torque(state.facing)
    return Truth(
        {
            "contact": float(a > 0),
            "contact_radius": a,
            "stick_radius": c,
            "incipient": float(loose and sheared and not slips),
            "slip": float(slips),
            "slip_speed": speed if slips else 0.0,
            "slip_direction": atan2(state.slipped[1], state.slipped[0]) if slips else 0.0,
            "twist": turned,
            "twist_rate": turn * rate,
            "twist_slip": float(loose and not sheared and turn != 0.0),
            "normal_force": state.load,
            "shear_x": shear_x,
            "shear_y": shear_y,
            "torque": torque,
            "x": float(state.position[0]),
            "y": float(state.position[1]),
            "friction": springs.pair.friction,
            **other,
        }
    )
