"""Scene files as plays: the same judgement for a scene that a user wrote."""

from pathlib import Path

from cnnum.drivers.registry import driver_options
from cnnum.drivers.simulated.settings import Settings
from cnnum.engine import Engine
from cnnum.errors import SceneError
from cnnum.lab.scoring.play import Play, spans_of
from cnnum.report.record import SceneRecorder
from cnnum.scenes.pipeline import Scene, load_scene

NEEDED = ("contact", "incipient", "slip", "twist_slip", "stick_radius")
"""Ground truth without which a scene cannot be scored."""

FIELDS = ("contact", "slip", "twist", "slip_strength")


def play_scene(name: str | Path, engine: Engine | None = None) -> Play:
    """Run a scene for contact, slip and twist, whatever else it wants.

    Parameters
    ----------
    name : str or Path
        A TOML file, or the name of a scene that comes with the package.
    engine : Engine, optional
        To run on instead of the scene's own.

    Raises
    ------
    SceneError
        If the scene's array does not know the truth, or misses what a play needs.
    """
    scene = load_scene(name, engine=engine, changes={"wants": list(FIELDS)})
    recorder = SceneRecorder(scene)
    for moment in scene.results():
        recorder.add(moment)
    record = recorder.record()
    missing = [key for key in NEEDED if key not in record.truth]
    if missing or record.pitch is None:
        raise SceneError(
            f"Scene '{name}' cannot be scored: expected an array that tells the truth "
            f"({', '.join(NEEDED)}), got none of {', '.join(missing) or 'its pitch'}; use the "
            "driver 'simulated', or name the folder of labelled trials."
        )
    settings = _settings(scene)
    return Play(
        name=record.name,
        suite=record.name,
        seed=settings.seed if settings else None,
        shape=record.shape,
        rate=record.rate,
        pitch=record.pitch,
        times=record.times,
        truth=record.truth,
        outputs={key: values for key, values in record.outputs.items() if values.ndim == 1},
        events=record.events,
        phases=spans_of(settings.script, settings.rate) if settings else (),
    )


def _settings(scene: Scene) -> Settings | None:
    spec = scene.spec
    options = driver_options(spec.driver, spec.driver_options, base=spec.base)
    return options if isinstance(options, Settings) else None
