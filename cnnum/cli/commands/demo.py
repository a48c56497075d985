"""`cnnum demo`: the simulated scene, its events as they come, and a report of it."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

import click

from cnnum.cli.following import follow
from cnnum.cli.options import Changes, file_option, force_option, json_option, scene_options
from cnnum.cli.output import COMPILING, Output, Steps, busy, progress
from cnnum.drivers.driver import Closing
from cnnum.engine import Engine
from cnnum.recordings.journal import Journal
from cnnum.report import (
    PlanCost,
    SceneRecorder,
    WorkPrecision,
    measure_work_precision,
    write_demo_report,
)
from cnnum.scenes.frame_path import FrameResult
from cnnum.scenes.pipeline import Scene
from cnnum.templating.checks import run_check
from cnnum.templating.library import get_template, template_names, template_path
from cnnum.templating.template import Template

Outcome = TypeVar("Outcome")

CHECKED = ("edges", "tactile")
"""Groups of the library that are checked."""

LADDERS = ("tactile_diffusion", "contact_outline")
"""Templates whose error is shown against the run time of every method: a linear one, and one whose
cells saturate. Both run for a fixed time: to settle takes the reference too long."""

LADDER_BATCH, REPEATS = 64, 3


class DemoReport(Closing):
    """Takes in the moments of a scene, then measures and writes.

    Parameters
    ----------
    scene : Scene
    path : Path
        Path of the report.
    force : bool
        Whether a file that is there, and is no report of cnnum, is replaced.
    as_json : bool
        Whether records are printed, which keeps progress from their terminal.
    """

    def __init__(self, scene: Scene, path: Path, *, force: bool, as_json: bool) -> None:
        self._scene, self._path, self._as_json = scene, path, as_json
        self._force = force
        self._record = SceneRecorder(scene)
        self._folder = TemporaryDirectory(prefix="cnnum-demo-")
        self._frames = Path(self._folder.name) / "frames.mcap"
        driver = scene.driver
        self._journal = Journal(self._frames, driver.rate, getattr(driver, "calibration", None))

    def close(self) -> None:
        """Drop the frames that were kept for measurements."""
        self._journal.close(index=False)
        self._folder.cleanup()

    def add(self, moment: FrameResult) -> None:
        """Take in the next moment."""
        self._record.add(moment)
        self._journal.add(moment.frame)

    def write(self) -> dict[str, str]:
        """Measure, write the report, and return its place for the summary."""
        self._journal.close(index=True)
        wants = dict.fromkeys((self._scene.spec.needs, ("contact",)))
        checks = _checks(self._scene.engine)
        total = 1 + len(checks) + len(LADDERS)
        with progress("report", total, as_json=self._as_json) as steps:
            plans = _told(steps, "cost of plans", partial(self._costs, wants))
            results = [
                _told(steps, template.name, partial(run_check, template, engine, repeats=REPEATS))
                for template, engine in checks
            ]
            points = [_told(steps, name, partial(self._climb, name)) for name in LADDERS]
            rungs = list(chain.from_iterable(points))
            record = self._record.record()
            write_demo_report(self._path, record, results, rungs, plans, force=self._force)
        return {"report": str(self._path)}

    def _costs(self, wants: Iterable[tuple[str, ...]]) -> tuple[PlanCost, ...]:
        """Measure plans on the frames of the scene, with no simulation at the same time."""
        options = {"path": str(self._frames)}
        # the cover of its frames is that of the scene, so that no parameter is only assumed
        specs = {
            ", ".join(needs): replace(
                self._scene.spec, driver="mcap", driver_options=options, needs=needs, usual=()
            )
            for needs in wants
        }
        engine = self._scene.engine
        return PlanCost.measure({label: Scene.of(spec, engine) for label, spec in specs.items()})

    def _climb(self, name: str) -> tuple[WorkPrecision, ...]:
        engines, template = [self._scene.engine], get_template(name)
        return measure_work_precision(template, engines, batch=LADDER_BATCH, repeats=REPEATS)


def _told(steps: Steps, note: str, work: Callable[[], Outcome]) -> Outcome:
    outcome = work()
    steps.advance(note)
    return outcome


def _checks(engine: Engine) -> list[tuple[Template, Engine]]:
    """Return the checks by engine: all on the scene's engine, the tactile ones on both."""
    reference = Engine("reference")
    groups = {name: template_path(name).parent.name for name in template_names()}
    here = [get_template(name) for name, group in groups.items() if group in CHECKED]
    checked = [template for template in here if template.check is not None]
    both = [t for t in checked if groups[t.name] == "tactile" and engine.name != reference.name]
    return [(t, engine) for t in checked] + [(t, reference) for t in both]


@click.command("demo")
@file_option("cnnum-demo.html", "File to write the report to.")
@scene_options
@force_option
@json_option
def command(
    out: Path,
    changes: Changes,
    force: bool,
    as_json: bool,
) -> int:
    """Run the packaged demo scene and write an HTML report.

    A sphere is pressed on a simulated 8×8 three-axial array, pulled until it slips, twisted and
    released. The report shows frames, events, ground truth, the operations that the plan leaves
    out, and the error and run time of the templates.
    """
    with busy(COMPILING, as_json=as_json):
        from cnnum.cli.commands.demo import DemoReport
        from cnnum.scenes.pipeline import load_scene

        scene = load_scene("demo", changes=changes)
    with DemoReport(scene, out, force=force, as_json=as_json) as report:
        return follow(scene, Output(as_json), watch=report.add, finish=report.write)
