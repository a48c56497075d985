"""The picture of docs/how-to/beyond-linear.md: `python -m docs.figures.beyond_linear`.

Each template file of the page runs on a picture of 16×16 cells, from its start to its end.
"""

import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import cnnum

PAGE = Path(__file__).parents[1] / "how-to/beyond-linear.md"
SIDE = 16
PALER = 0.55
"""Of ±1: pictures that a linear template can show without saturating."""


def templates() -> dict[str, cnnum.Template]:
    """Return the templates of the page by name, in its order."""
    with tempfile.TemporaryDirectory() as folder:
        path, found = Path(folder) / "page.toml", dict[str, cnnum.Template]()
        for text in re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL):
            path.write_text(text, encoding="utf-8")
            template = cnnum.load_template(path)
            found[template.name] = template
    return found


def _pictures() -> dict[str, tuple[dict[str, Any], list[float]]]:
    """Return for each template the maps of its run, and the times that are shown."""
    rng = np.random.default_rng(0)
    ring = -np.ones((SIDE, SIDE))
    ring[3:13, 3:13], ring[6:10, 6:10] = 1.0, -1.0
    noisy = 0.5 * ring + rng.uniform(-0.2, 0.2, ring.shape)
    light = np.linspace(-0.7, 0.7, SIDE) * np.ones((SIDE, 1))
    held = rng.random(ring.shape) < 0.12
    there = -np.ones_like(ring)
    there[4:9, 7:12] = 1.0
    return {
        "falls": ({"input": noisy}, [0.0, 0.7, 1.4, 4.0]),
        "smooth": ({"state": noisy}, [0.0, 0.5, 1.5, 4.0]),
        "motion": ({"input": there, "previous": np.roll(there, -3, 1)}, [0.0, 0.4, 2.0, 4.0]),
        "contrast": ({"input": PALER * ring}, [0.0, 0.5, 2.0, 40.0]),
        "focus": ({"input": PALER * ring}, [2.0, 6.0, 7.5, 12.0]),
        "threshold": ({"input": 0.25 * ring + light, "bias": -light}, [0.0, 0.7, 1.4, 6.0]),
        "membrane": ({"state": 0.9 * ring * held, "mask": held}, [0.0, 1.0, 4.0, 40.0]),
    }


TITLES = {
    "falls": "nonlinear: falls to the west",
    "smooth": "nonlinear: smooth, with edges",
    "motion": "delayed: what has changed",
    "contrast": "two layers: contrast",
    "focus": "gain: into focus",
    "threshold": "bias map: threshold in uneven light",
    "membrane": "fixed states: membrane",
}


def figure() -> Any:
    """Return the picture: for each template the map that it is given, and outputs at times."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made: Any = Figure(figsize=(10.4, 5.6), layout="constrained")
    FigureCanvasAgg(made)
    parts = made.subfigures(4, 2, hspace=0.06, wspace=0.05).ravel()
    found, engine = templates(), cnnum.Engine("numba")
    for part, (name, (maps, times)) in zip(parts, _pictures().items(), strict=False):
        part.suptitle(TITLES[name], fontsize=9.5, fontweight="bold", x=0.01, ha="left")
        shown = engine.run(found[name], **maps, at=[t for t in times if t > 0.0]).output
        outputs = shown if shown.ndim == 3 else shown[:, -1]
        given = maps.get("input", maps.get("state"))
        labels = [f"t = {t:g} τ" for t in times if t > 0.0]
        pictures = [given, *outputs][: 4 + (times[0] > 0.0)]
        axes = part.subplots(1, len(pictures))
        for axis, values, label in zip(axes, pictures, ["given", *labels], strict=True):
            axis.imshow(values, cmap="gray_r", vmin=-1.0, vmax=1.0)
            axis.set(xticks=[], yticks=[])
            axis.set_xlabel(label, fontsize=8)
            axis.spines[["top", "right"]].set_visible(True)
    parts[-1].text(
        0.02, 0.5, "black is +1, white is −1;\n“contrast” shows its second layer",
        fontsize=8.5, va="center",
    )  # fmt: skip
    return made


if __name__ == "__main__":
    from cnnum.report.plots import page_style

    with page_style():
        figure().savefig(PAGE.with_suffix(".png"), dpi=90)
