"""Programs and templates as WebAssembly for a page: the export to C, compiled by Zig."""

import base64
import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cnnum.embedded.c.files import MANIFEST, Exported
from cnnum.errors import DeviceError, NotSupportedError, missing_extra
from cnnum.graph.nodes import RunSpec
from cnnum.programs import Program
from cnnum.programs.fields import Field
from cnnum.programs.machine import FrameFields
from cnnum.programs.transients import transient
from cnnum.report.gallery import SHAPE
from cnnum.scenes.exporting import export
from cnnum.templating.checks import form_of
from cnnum.templating.template import Template

LIVELY = 4
"""Pictures on which the ranges of a live template are measured; waves take seconds of each."""


def compiled(exported: Exported, name: str) -> bytes:
    """Return the module of an export in whole numbers.

    Parameters
    ----------
    exported : Exported
        With the package "wasm".
    name : str
        Name of its C file, without suffix.

    Raises
    ------
    MissingExtraError
        If Zig is not installed.
    DeviceError
        If Zig refuses the module.
    """
    if find_spec("ziglang") is None:
        raise missing_extra("building WebAssembly", "ziglang", "embedded")
    command = [*(sys.executable, "-P", "-m", "ziglang", "cc"), "-target", "wasm32-freestanding"]
    command += ["-Os", "-nostdlib", "-ffp-contract=off", "-Wl,--no-entry", "-Wl,--strip-all"]
    with TemporaryDirectory() as place:
        folder = Path(place)
        exported.write(folder)
        done = subprocess.run(
            [*command, "-o", "page.wasm", "wasm.c", f"{name}.c"],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode:
            raise DeviceError(f"Zig refused '{name}': {done.stderr:.400}")
        return (folder / "page.wasm").read_bytes()


def live_module(template: Template) -> dict[str, object] | None:
    """Return a template as WebAssembly for `Card.live`, or None if a page cannot show its maps.

    The module is its export in q15, on a picture of its check; it has one layer and takes an input,
    an initial state, or both.

    Raises
    ------
    MissingExtraError, DeviceError
        As of `compiled`.
    """
    case = form_of(template).cases(template, np.random.default_rng(3), SHAPE)
    maps = {key: getattr(case, key) for key in ("input", "state") if case.given[key] is not None}
    others = any(case.given[key] is not None for key in ("previous", "bias", "mask"))
    if others or template.layers > 1 or any(np.ndim(value) != 3 for value in maps.values()):
        return None

    def function(frame: FrameFields) -> dict[str, Field]:
        given = {key: getattr(frame, key) for key in maps}
        spec = RunSpec() if case.duration is None else RunSpec(duration=case.duration)
        return {"output": transient(template, spec=spec, **given).outputs[0]}

    frames = np.stack([value[-LIVELY:] for value in maps.values()], axis=-1)
    program = Program(function, "template")
    try:
        exported = export(program, like=frames, channels=tuple(maps)).packaged("wasm")
    except NotSupportedError:
        return None
    wasm, record = compiled(exported, "template"), json.loads(exported.files[MANIFEST])
    return {
        "wasm": base64.b64encode(wasm).decode(), "rows": SHAPE[0], "cols": SHAPE[1],
        "maps": [maps[part["name"]][-1].ravel().tolist() for part in record["inputs"]],
        "scales": [2 ** part["fraction"] for part in record["inputs"]],
        "scale": 2 ** record["outputs"][0]["fraction"],
    }  # fmt: skip
