"""How often `mindlin_slip` says that a contact begins to slide, before all of it does.

`python docs/figures/incipient_slip.py [--count 6] [--seed 2000000] [--contact 3.2e-3]` plays
families of scenes of `cnnum score`. In some a sphere is pulled over a half-space, and the truth is
Mindlin's c/a. In the others the law does not hold for the bodies. The program knows friction, cover
and rate of each scene, as its user has to. In two families it is given a wrong depth. A report is
in time while less than half the radius sticks, early before that. With `--contact` all spheres have
that contact radius, m. It prints the rows of the table in `docs/scoring.md`.
"""

import argparse
from collections.abc import Sequence

import numpy as np

from cnnum.drivers.simulated import grips as pulls
from cnnum.drivers.simulated.grips import PITCH, Array, Arrays, Draw, Make, Trial, first, pulled
from cnnum.engine import Engine
from cnnum.frame import FORCE_AXES
from cnnum.lab.scoring.families import faces
from cnnum.lab.scoring.families.catalogue import dragged
from cnnum.programs.library import get_program

OUTPUTS = ("mindlin_holds", "incipient_slip")
PULLS = {
    "constant speed": pulls.power(1.0),
    **{f"t^{power:g}": pulls.power(power) for power in (0.5, 0.7, 1.5, 2.0, 3.0)},
    "force ramp": pulls.force_ramp,
    "tremor": pulls.tremor,
    "stick-slip": pulls.weakening,
}
SET = {"depth set ×0.67": 1 / 1.5, "depth set ×1.5": 1.5}
"""Families pulled at a constant speed whose program is given another depth of cover."""

OTHERS = {"flat punch": faces.punch, "bar": faces.bar, "ridges": faces.ridges}


def made(contact: float | None) -> dict[str, Make]:
    """Return the functions that make the scenes of each family."""
    spheres = {name: pulled(pull, Array(contact=contact)) for name, pull in PULLS.items()}
    spheres |= {name: pulled(pulls.power(1.0), Array(contact=contact)) for name in SET}
    layer = pulled(pulls.power(1.0), Array(cover="layer", contact=contact))
    return {**spheres, "layer": layer, **{name: dragged(face) for name, face in OTHERS.items()}}


def play(engine: Engine, trial: Trial) -> dict[str, np.ndarray]:
    """Return the program's outputs for a scene, an array of frames each."""
    array = Array(cover="layer" if trial.family == "layer" else "flat")
    draw = Draw.of(trial.family, int(trial.name.rpartition(" ")[2]), array)
    depth = draw.thickness / PITCH * SET.get(trial.family, 1.0)
    program = get_program("mindlin_slip").bind(
        friction=draw.bounds.friction, depth=depth, rate=trial.rate
    )
    plan = engine.compile(program, trial.shape, OUTPUTS, channels=FORCE_AXES)
    stream = plan.stream(())
    columns = [FORCE_AXES.index(channel) for channel in plan.schedule.channels]
    said = [stream.push(frame[..., columns]) for frame in trial.frames]
    return {name: np.array([float(one[name]) for one in said]) > 0 for name in OUTPUTS}


def row(family: str, trials: Sequence[Trial], engine: Engine) -> str:
    """Return a family's row of the table."""
    trusted = in_time = early = 0
    leads = list[float]()
    for trial in trials:
        said = play(engine, trial)
        onset, loose = trial.onset, first(trial.early)
        reported = first(said["incipient_slip"])
        trusted += bool(said["mindlin_holds"][:onset].any())
        in_time += loose <= reported < onset
        early += reported < min(loose, onset)
        leads += [(onset - reported) / trial.rate] if reported < onset else []
    lead = f"{np.median(leads):.2f}" if leads else "–"
    shares = " | ".join(f"{count / len(trials):.2f}" for count in (trusted, in_time, early))
    return f"| {family} | {shares} | {lead} |"


def main() -> None:
    """Print the table."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("--count", type=int, default=6)
    arguments.add_argument("--seed", type=int, default=2_000_000)
    arguments.add_argument("--contact", type=float)
    given = arguments.parse_args()
    engine, arrays = Engine("numba"), Arrays()
    print("| family | trusted | in time | early | lead, s |\n|---|---|---|---|---|")
    for family, make in made(given.contact).items():
        seeds = range(given.seed, given.seed + given.count)
        print(row(family, [make(arrays, family, n) for n in seeds], engine), flush=True)


if __name__ == "__main__":
    main()
