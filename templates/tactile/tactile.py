"""All outputs of a calibrated array, as one program with shared fields."""

from collections.abc import Mapping

from cnnum.programs import program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.parameters import refuse_outside
from cnnum.tactile.indenters import Reads
from cnnum.templates.tactile.contact import contact
from cnnum.templates.tactile.cover_model.fields import DEPTH, READS
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
    reads: Reads = READS,
    unit: float = 1.0,
    bump_pitch: float = BUMP_PITCH,
    bump_depth: float = BUMP_DEPTH,
    bump_unit: float = 1.0,
    rest: float = 0.4,
    slip_false_reports: float = 2.0,
    twist_false_reports: float = 0.3,
) -> Mapping[str, Field]:
    """Contact, slip, twist, edges and bumps; compile it with the outputs that are needed.

    The stream must begin without contact: its first frames define rest.

    Parameters
    ----------
    frame, push, depth, reads, unit
        As in `contact`; taxels that each carry their own load have no edges.
    bump_pitch, bump_depth, bump_unit
        As `bump_pitch`, `bump_depth` and `unit` of `localize`.
    rest : float, s
        The time at the start without contact, for `slip` and `twist`.
    slip_false_reports, twist_false_reports : float, 1/10 min
        Accepted rates, as `false_reports` of `slip` and `twist`.

    Returns
    -------
    mapping
        All outputs of `contact`, `slip`, `twist`, `edges` and `localize`.
    """
    refuse_outside(depth=(depth, 1e-6, 1e6))
    cover = {"push": push, "depth": depth, "reads": reads}
    bumps = {"bump_pitch": bump_pitch, "bump_depth": bump_depth, "unit": bump_unit}
    times = {"push": push, "rest": rest}
    return {
        **contact.bind(**cover, unit=unit)(frame),
        **slip.bind(**times, false_reports=slip_false_reports)(frame),
        **twist.bind(**times, false_reports=twist_false_reports)(frame),
        **edges.bind(**cover)(frame),
        **localize.bind(push=push, **bumps)(frame),
    }
