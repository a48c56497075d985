"""All outputs of a calibrated array, as one program with shared fields."""

from collections.abc import Mapping

from cnnum.frame import FORCE_AXES, NORMAL
from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.templates.tactile.contact import contact
from cnnum.templates.tactile.cover_model.fields import DEPTH, READS, Carries
from cnnum.templates.tactile.edges import edges
from cnnum.templates.tactile.localize import DEPTH as BUMP_DEPTH
from cnnum.templates.tactile.localize import PITCH as BUMP_PITCH
from cnnum.templates.tactile.localize import localize
from cnnum.templates.tactile.shared.loads import PUSH
from cnnum.templates.tactile.slip import slip
from cnnum.templates.tactile.twist import twist


@program
def tactile(
    frame: FrameFields,
    *,
    push: float = PUSH,
    depth: float = DEPTH,
    reads: Carries = READS,
    unit: float = 1.0,
    bump_pitch: float = BUMP_PITCH,
    bump_depth: float = BUMP_DEPTH,
    bump_unit: float = 1.0,
    rest: float = 0.4,
    shear_gain: float = 1.0,
    pads: int = 1,
    slip_false_reports: float = 2.0,
    twist_false_reports: float = 0.3,
    slip_level: float = 0.0,
    twist_level: float = 0.0,
) -> Mapping[str, Field]:
    """Detect contact, slip, twist, edges and bumps; compile it with only the outputs you need.

    The stream must begin without contact: its first frames define rest. For an array that reads
    fewer than three axes, some outputs are missing: slip and twist without shear, and contact,
    edges and bumps without a normal load.

    Parameters
    ----------
    frame, push, depth, reads, unit
        As in `contact`.
    bump_pitch, bump_depth, bump_unit
        As `bump_pitch`, `bump_depth` and `unit` in `localize`.
    rest : float, s
        Time without contact at the start, for `slip` and `twist`.
    shear_gain, pads
        As in `slip`. The position of a contact or a twist is on the pad where it is strongest.
    slip_false_reports, twist_false_reports : float, 1/10 min
        Accepted rates, as `false_reports` in `slip` and `twist`.
    slip_level, twist_level : float
        The levels themselves, as `level` there, if they are above 0.

    Returns
    -------
    mapping
        All outputs of `contact`, `slip`, `twist`, `edges` and `localize`.
    """
    refuse_outside(depth=(depth, 1e-6, 1e6))
    sheared = all(name in frame.channels for name in FORCE_AXES[:2])
    pushed = NORMAL in frame.channels or not sheared  # of neither, the error names the load
    cover = {"push": push, "depth": depth, "reads": reads}
    bumps = {"bump_pitch": bump_pitch, "bump_depth": bump_depth, "unit": bump_unit}
    settings = {"push": push, "rest": rest, "shear_gain": shear_gain, "pads": pads}
    result: dict[str, Field] = {}
    if pushed:
        result |= contact.bind(**cover, unit=unit, normal_gain=1.0 / shear_gain, pads=pads)(frame)
    if sheared:
        for moving, rate, level in (
            (slip, slip_false_reports, slip_level),
            (twist, twist_false_reports, twist_level),
        ):
            result |= moving.bind(**settings, false_reports=rate, level=level)(frame)
    if pushed:
        result |= edges.bind(**cover)(frame)
        result |= localize.bind(push=push, **bumps)(frame)
    return result
