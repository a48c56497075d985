"""False reports of `slip` and `twist` by their level: `python docs/figures/false_reports.py`.

It plays the families of `cnnum score` without slip, but for rolling, bristles and oblique touches,
and counts reports by level; with `--oblique`, it plays oblique touches alone. `LEVELS` of
`templates/tactile/slip.py` and `twist.py` are at least the bounds that come out, and with
`--shear-alone`, which plays bristles and oblique touches, too, their `SHEAR_LEVELS`.
"""

import argparse
from functools import partial

from scipy.special import gammaincinv

from cnnum.drivers.simulated.grips import Arrays, runs
from cnnum.engine import Engine
from cnnum.frame import FORCE_AXES
from cnnum.lab.scoring.families.catalogue import FAMILIES
from cnnum.lab.scoring.judge import judge, per_ten_minutes
from cnnum.lab.scoring.subjects import in_batches, reports, side_by_side
from cnnum.programs.library import get_program
from cnnum.templates.tactile import twist

LEVELS = (0.20, 0.25, 0.28, 0.32, 0.36, 0.40, 0.45, 0.50, 0.55, 0.60)


def rates(count: int, seconds: float) -> str:
    """Return a count, its rate, and the upper bound of that rate: Poisson's, at 90 %."""
    bound = float(gammaincinv(count + 1.0, 0.9)) * per_ten_minutes(1, seconds)
    rate = per_ten_minutes(count, seconds)
    return f"{count} reports, {rate:.2f} in ten minutes, at most {bound:.2f}"


def main() -> None:
    """Print a row a level of each program."""
    arguments = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    arguments.add_argument("--count", type=int, default=24)
    arguments.add_argument("--seed", type=int, default=700_000)
    arguments.add_argument("--shear-alone", action="store_true", help="as arrays of markers read")
    arguments.add_argument("--oblique", action="store_true", help="touches that come with shear")
    given = arguments.parse_args()
    channels = FORCE_AXES[:2] if given.shear_alone else FORCE_AXES
    engine, arrays = Engine(), Arrays()
    seeds = range(given.seed, given.seed + given.count)
    left_out = ("rolling",) if given.shear_alone else ("rolling", "bristles", "oblique")
    held = [one for one in FAMILIES if one.kind == "held" and not one.name.startswith(left_out)]
    if given.oblique:
        held = [one for one in FAMILIES if one.name.startswith("oblique")]
    trials = [family.make(arrays, family.name, seed) for family in held for seed in seeds]
    seconds = sum(trial.seconds for trial in trials)
    print(f"{seconds / 60.0:.1f} minutes")
    run = partial(side_by_side, engine, get_program("slip"), ("slip_strength",), channels=channels)
    strengths = [one["slip_strength"] for one in in_batches(trials, run)]
    for level in LEVELS:
        pairs = zip(trials, strengths, strict=True)
        false = sum(judge(t, {}, reports(one, level, t.rate)).false for t, one in pairs)
        print(f"slip {level:.2f}: {rates(false, seconds)}")
    for rate, level in twist.SHEAR_LEVELS if given.shear_alone else twist.LEVELS:
        known = {"false_reports": rate}
        run = partial(
            side_by_side, engine, get_program("twist"), ("twist",), constants=known,
            channels=channels,
        )  # fmt: skip
        turns = zip(trials, in_batches(trials, run), strict=True)
        false = sum(len(runs((one["twist"] > 0) & t.scored)) for t, one in turns)
        print(f"twist {level:.2f}: {rates(false, seconds)}")


if __name__ == "__main__":
    main()
