"""cnnum: an emulator of the cellular-wave computer that processes tactile scenes.

Names are imported when they are first used, so that `import cnnum` is quick and needs NumPy alone.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from cnnum.version import __version__

if TYPE_CHECKING:
    from cnnum import tactile
    from cnnum.drivers.recording_file import load_recording
    from cnnum.engine import Engine
    from cnnum.errors import CnnumError
    from cnnum.frame import Frame, Quality
    from cnnum.graph.nodes import RunSpec
    from cnnum.integrators.stability import stability_bound
    from cnnum.pictures import as_picture, load_picture, save_picture
    from cnnum.plan import Plan
    from cnnum.programs import Program, program
    from cnnum.programs.fields import Field, exp, maximum, minimum, sqrt, where
    from cnnum.programs.library import get_program, program_names
    from cnnum.programs.logic import logic
    from cnnum.programs.loops import branch, loop
    from cnnum.programs.transients import apply, shift, transient
    from cnnum.recordings.recording import Recording
    from cnnum.runs.analysis import Analysis, analyse, analyse_program
    from cnnum.runs.chip import Chip
    from cnnum.runs.result import Result
    from cnnum.scenes.event_list import EventList
    from cnnum.scenes.events import Event
    from cnnum.scenes.pipeline import load_scene
    from cnnum.templating.batch import TemplateBatch
    from cnnum.templating.files import load_template, save_template
    from cnnum.templating.library import get_template, template_names
    from cnnum.templating.template import Check, Template

_HOME = {
    "as_picture": "cnnum.pictures",
    "load_picture": "cnnum.pictures",
    "save_picture": "cnnum.pictures",
    "Recording": "cnnum.recordings.recording",
    "load_recording": "cnnum.drivers.recording_file",
    "Engine": "cnnum.engine",
    "Analysis": "cnnum.runs.analysis",
    "analyse": "cnnum.runs.analysis",
    "analyse_program": "cnnum.runs.analysis",
    "Chip": "cnnum.runs.chip",
    "Result": "cnnum.runs.result",
    "CnnumError": "cnnum.errors",
    "Event": "cnnum.scenes.events",
    "EventList": "cnnum.scenes.event_list",
    "Frame": "cnnum.frame",
    "Quality": "cnnum.frame",
    "RunSpec": "cnnum.graph.nodes",
    "stability_bound": "cnnum.integrators.stability",
    "get_template": "cnnum.templating.library",
    "template_names": "cnnum.templating.library",
    "load_scene": "cnnum.scenes.pipeline",
    "Plan": "cnnum.plan",
    "get_program": "cnnum.programs.library",
    "program_names": "cnnum.programs.library",
    "Program": "cnnum.programs",
    "program": "cnnum.programs",
    "Field": "cnnum.programs.fields",
    "branch": "cnnum.programs.loops",
    "loop": "cnnum.programs.loops",
    "logic": "cnnum.programs.logic",
    "shift": "cnnum.programs.transients",
    "exp": "cnnum.programs.fields",
    "maximum": "cnnum.programs.fields",
    "minimum": "cnnum.programs.fields",
    "sqrt": "cnnum.programs.fields",
    "where": "cnnum.programs.fields",
    "apply": "cnnum.programs.transients",
    "transient": "cnnum.programs.transients",
    "Check": "cnnum.templating.template",
    "Template": "cnnum.templating.template",
    "TemplateBatch": "cnnum.templating.batch",
    "load_template": "cnnum.templating.files",
    "save_template": "cnnum.templating.files",
}

__all__ = [
    "Analysis",
    "Check",
    "Chip",
    "CnnumError",
    "Engine",
    "Event",
    "EventList",
    "Field",
    "Frame",
    "Plan",
    "Program",
    "Quality",
    "Recording",
    "Result",
    "RunSpec",
    "Template",
    "TemplateBatch",
    "__version__",
    "analyse",
    "analyse_program",
    "apply",
    "as_picture",
    "branch",
    "exp",
    "get_program",
    "get_template",
    "load_picture",
    "load_recording",
    "load_scene",
    "load_template",
    "logic",
    "loop",
    "maximum",
    "minimum",
    "program",
    "program_names",
    "save_picture",
    "save_template",
    "shift",
    "sqrt",
    "stability_bound",
    "tactile",
    "template_names",
    "transient",
    "where",
]


def __getattr__(name: str) -> object:
    """Import a public name from its room when it is first asked for."""
    if name == "tactile":
        return import_module("cnnum.tactile")
    if name not in _HOME:
        raise AttributeError(f"module 'cnnum' has no attribute '{name}'")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Name all public objects, for completion, without an import."""
    return sorted({*globals(), *__all__})
