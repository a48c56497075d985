"""A scene file: which array, read how, by which program, for which events and fields."""

import math
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Any, cast

from cnnum.drivers.geometry import Positions, Reading
from cnnum.drivers.options import convert, read_options
from cnnum.errors import ArrayError, SceneError, missing_file, name_error, unreadable
from cnnum.frame import Limits, limits_of
from cnnum.programs import Program
from cnnum.renamed import by_new_names
from cnnum.safety.reading import LARGEST, names_something, parse_toml, read_text
from cnnum.safety.values import LONGEST, checked_name, shown, tidied, visible
from cnnum.scenes.events import EventRule, event_rule
from cnnum.tactile.array_calibration import KEYS, ArrayCalibration

_TABLES = ("array", "frames", "calibration", "program", "engine")
_KEYS = ("name", "needs", *_TABLES, "event")

_FRAMES = (
    "range",
    "dead",
    "limits",
    "bandwidth",
    "tare",
    "positions",
    "pitch",
    "channels",
    "order",
    "flip",
    "unit",
    "time_unit",
)

RENAMED = {"wants": "needs"}
"""Old keys, which work for one more version."""


EVERYTHING = "everything"
"""A want: every event and every output that the program gives."""


@dataclass(frozen=True, slots=True)
class SceneSpec:
    """The content of a scene file.

    Attributes
    ----------
    name : str
    needs : tuple of str
        Events ("contact", "slip", "twist", "edge") and outputs of the program, or "everything";
        the rest of the program is left out. Events of one's own are wanted where they are given.
    driver : str
    driver_options : mapping
    frame_range : float or None
        Largest magnitude of a good frame's values, in the driver's unit, where the scene says so.
    dead : tuple of (row, column)
        Taxels whose values come from their neighbours.
    limits : (low, high), or one pair per channel, or None
        Raw values beyond which a taxel has dropped out, in the driver's unit.
    bandwidth : float or None, Hz
        Highest frequency of loads on the array.
    tares : tuple of float, s
        Times after the first frame from which on rest and noise are learned anew.
    positions : sequence of (x, y), mm
        Positions of the taxels, row by row, where they lie on no square grid and the array does not
        say it.
    pitch : float or None, m
        Size of a cell of the grid that is made of them.
    reading : Reading
        Order, signs and unit of the numbers of a frame, where the array has them otherwise.
    calibration : str
        "driver" (the driver's own knowledge of its array), "none", or the path of a file.
    scale : ArrayCalibration or None
        Gain, offset and tare of the raw values, where the scene says them.
    program : str or Program
        Name of a program of the library, "module:function" or "file.py:function" of one's own, or
        the program itself.
    parameters : mapping
        Parameters of the program.
    usual : tuple of str
        Parameters as a packaged scene has them, for its usual array: one that knows better gives
        its own.
    engine, device, precision, fallback : str or None
    ranges : mapping or None
        Driver and options of a recording on which whole numbers measure their ranges.
    base : Path
        Folder that relative paths start from: the file's own.
    events : tuple of EventRule
        One's own, from the outputs of the program.

    Raises
    ------
    SceneError
        If nothing is wanted, or a name is not one line of plain signs.
    """

    name: str
    needs: tuple[str, ...]
    driver: str
    driver_options: Mapping[str, object] = field(default_factory=dict[str, object])
    frame_range: float | None = None
    dead: tuple[tuple[int, int], ...] = ()
    calibration: str = "driver"
    scale: ArrayCalibration | None = None
    program: "str | Program" = "tactile"
    parameters: Mapping[str, object] = field(default_factory=dict[str, object])
    engine: str | None = None
    device: str | None = None
    precision: str | None = None
    ranges: Mapping[str, object] | None = None
    fallback: str | None = None
    base: Path = Path()
    events: tuple[EventRule, ...] = ()
    limits: Limits | None = None
    bandwidth: float | None = None
    tares: tuple[float, ...] = ()
    positions: Positions = ()
    pitch: float | None = None
    reading: Reading = field(default_factory=Reading)
    usual: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        checked_name("a scene", self.name, SceneError)
        if not self.needs and not self.events:
            raise SceneError(f"Scene '{self.name}': 'needs' must name at least one event or field.")
        for want in self.needs:
            checked_name(f"a want of scene '{self.name}'", want, SceneError)
        named = {"driver": self.driver, "program": self.program_name, "engine": self.engine}
        for part, name in named.items():
            if name is not None or part != "engine":
                # a place of code is a path, which may be long and hold any sign that a line shows
                place, _, leaf = str(name).rpartition(":")
                in_file = place.endswith(".py") and visible(place) == place and "\n" not in place
                checked_name(
                    f"the {part} of scene '{self.name}'", leaf if in_file else name, SceneError
                )

    @property
    def program_name(self) -> str:
        """Name of the program."""
        return self.program.name if isinstance(self.program, Program) else self.program

    @property
    def own(self) -> tuple[str, ...]:
        """Kinds of one's own events."""
        return tuple(dict.fromkeys(rule.kind for rule in self.events))


def scene_names() -> tuple[str, ...]:
    """Return the names of the packaged scenes."""
    folder = resources.files("cnnum.scenes")
    return tuple(sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".toml")))


def read_scene(
    scene: str | Path, *, changes: Mapping[str, object] | None = None, trust: bool = False
) -> SceneSpec:
    """Read a scene file, or one of the scenes that come with the package.

    Parameters
    ----------
    scene : str or Path
        Path of a TOML file, or a name.
    changes : mapping of str to object, optional
        Values to set over those of the file, by dotted key: {"array.seed": 3}.
    trust : bool
        Whether a driver or a program that the file names as "module:name" may be imported, which
        runs its code. One that `changes` names may be.

    Raises
    ------
    SceneError
        If the file is not there, is not TOML, a key is unknown, missing or of a wrong type, or if
        it names code and is not trusted.
    """
    table, base = _table_of(scene)
    usual = _parameters_of(table) if str(scene) in scene_names() else []
    for key, value in by_new_names(changes or {}, RENAMED).items():
        _set(table, key, value)
        usual = [name for name in usual if not f"program.parameters.{name}.".startswith(f"{key}.")]
    if SKIN in table:
        raise SceneError(
            f"'{scene}' is a hand of several skins, for 'cnnum run', 'cnnum record', 'cnnum view' "
            "and cnnum.load_hand."
        )
    spec = replace(_spec(str(scene), table, base), usual=tuple(usual))
    if not trust:
        _refuse_code(spec, scene, changes or {})
    return spec


SKIN = "skin"
"""Table of a hand file, with a table for each skin."""


def read_hand(
    hand: str | Path, *, changes: Mapping[str, object] | None = None, trust: bool = False
) -> dict[str, SceneSpec]:
    """Read a hand file: the keys of a scene, and a table [skin.NAME] for each skin.

    The keys outside these tables are those of all skins. A skin's table has the keys of a scene,
    too, and stands above them; with ``scene = "FILE"`` it takes that scene in place of them. A
    skin with another driver or program takes none of the options of the common one.

    Parameters
    ----------
    hand : str or Path
    changes : mapping of str to object, optional
        As of `read_scene`, for all skins; "skin.NAME.KEY" is for one.
    trust : bool

    Returns
    -------
    dict of str to SceneSpec
        Keyed by skin name, in the file's order.

    Raises
    ------
    SceneError
        As `read_scene`, or if the file has no skin.
    UnknownNameError
        If a change is for a skin that the file does not have.
    """
    table, base = _table_of(hand)
    given = by_new_names(changes or {}, RENAMED)
    skins = _table(str(hand), table, SKIN)
    for key, value in given.items():
        if key.startswith(f"{SKIN}."):
            if skins and (name := key.split(".")[1]) not in skins:
                raise name_error("skin", name, tuple(skins))
            _set(table, key, value)
    if not skins:
        raise SceneError(f"'{hand}' is a scene, not a hand: a hand has a table [skin.NAME] each.")
    common = {key: value for key, value in table.items() if key not in (SKIN, "name")}
    result: dict[str, SceneSpec] = {}
    for name in skins:
        checked_name(f"a skin of '{hand}'", name, SceneError)
        label = f"{hand}, skin {name}"
        own, under, folder = dict(_table(str(hand), skins, name)), common, base
        usual: list[str] = []
        if "scene" in own:
            scene = _text(label, own, "scene", None)
            del own["scene"]
            under, folder = _table_of(base / scene if (base / scene).exists() else scene)
            usual = _parameters_of(under) if scene in scene_names() else []
            usual = [key for key in usual if key not in _parameters_of(own)]
        merged = _over(under, own) | {"name": name}
        for key, value in given.items():
            if not key.startswith(f"{SKIN}."):
                _set(merged, key, value)
        spec = replace(_spec(label, merged, folder), usual=tuple(usual))
        if not trust:
            _refuse_code(spec, label, changes or {})
        result[name] = spec
    return result


def is_hand(scene: str | Path) -> bool:
    """Return whether a scene file has several skins.

    Raises
    ------
    SceneError
        If it is not there, or is not TOML.
    """
    return SKIN in _table_of(scene)[0]


OF_ONE = {"array": "driver", "program": "name"}
"""Tables whose other keys are options of what this key names."""


def _over(under: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Return tables with those of a skin over them."""
    merged: dict[str, Any] = {}
    for key in dict.fromkeys((*under, *own)):
        low, high = under.get(key), own.get(key)
        if isinstance(low, dict) and isinstance(high, dict):
            below, above = cast("tuple[dict[str, Any], dict[str, Any]]", (low, high))
            leaf = OF_ONE.get(key, "")
            other = leaf in above and above[leaf] != below.get(leaf)
            merged[key] = dict(above) if other else _over(below, above)
        else:
            merged[key] = deepcopy(own.get(key, low))
    return merged


def scene_table(scene: str | Path, changes: Mapping[str, object] | None = None) -> dict[str, Any]:
    """Return the tables of a scene file with changes, as TOML has them; paths are whole.

    Raises
    ------
    SceneError
        If the file is not there, or is not TOML.
    """
    table, base = _table_of(scene)
    for name, key in (("array", "path"), ("calibration", "file")):
        held = table.get(name)
        if isinstance(held, dict) and isinstance(path := cast("Any", held).get(key), str):
            held[key] = str((base / path).absolute())
    for key, value in by_new_names(changes or {}, RENAMED).items():
        _set(table, key, value)
    return table


def _table_of(scene: str | Path) -> tuple[dict[str, Any], Path]:
    """Return the tables of a scene file, and the folder that its paths start from."""
    text, base = _found(scene)
    try:
        return by_new_names(parse_toml(text), RENAMED), base
    except ValueError as error:
        raise SceneError(f"Scene '{scene}' is not TOML: {error}.") from None


def _parameters_of(table: Mapping[str, object]) -> list[str]:
    program = table.get("program")
    result = (
        cast("dict[str, object]", program).get("parameters") if isinstance(program, dict) else 0
    )
    return list(cast("dict[str, object]", result)) if isinstance(result, dict) else []


def _refuse_code(spec: SceneSpec, scene: str | Path, changes: Mapping[str, object]) -> None:
    """Raise if a driver or program is code that the user has not named."""
    drivers = set(_named_drivers(changes))
    programs = {changes.get("program.name")}
    if isinstance(table := changes.get("program"), Mapping):
        programs.add(cast("Mapping[str, object]", table).get("name"))
    for what, key, name, named in (
        ("driver", "array", spec.driver, drivers),
        ("driver", "engine.ranges", (spec.ranges or {}).get("driver"), drivers),
        ("program", "program", spec.program, programs),
    ):
        if isinstance(name, str) and ":" in name and name not in named:
            raise SceneError(
                f"Scene '{scene}': its {what} {shown(name)} in '{key}' is code that would run "
                "with your permissions: read that module, then give --trust (in Python "
                "trust=True)."
            )


def _named_drivers(changes: Mapping[str, object]) -> Iterator[str]:
    """Yield what the user gives as a driver: a file of such a name is no permission."""
    for key, value in changes.items():
        if isinstance(value, Mapping):
            yield from _named_drivers(cast("Mapping[str, object]", value))
        elif isinstance(value, str) and key.rpartition(".")[2] == "driver":
            yield value


def text_of(scene: str | Path) -> str:
    """Return the text of a scene file, or of one of the scenes that come with the package.

    Raises
    ------
    SceneError
        If it is not there, or cannot be read.
    """
    return _found(scene)[0]


def _found(scene: str | Path) -> tuple[str, Path]:
    """Return the text of a scene, and the folder that its paths start from."""
    if not isinstance(cast(object, scene), str | Path):
        raise SceneError(
            f"A scene must be a TOML file or the name of one, got {type(scene).__name__}."
        )
    path = Path(scene)
    if str(scene) in scene_names():
        packaged = resources.files("cnnum.scenes") / f"{scene}.toml"
        return packaged.read_text(encoding="utf-8"), Path()
    if names_something(path):
        return _read(path), path.parent
    known = ", ".join(scene_names())
    said = f"There is no scene {shown(str(scene))}: expected a TOML file or one of {known}."
    raise missing_file(SceneError, said)


def _read(path: Path) -> str:
    try:
        return read_text(path, most=LARGEST)
    except OSError as error:
        raise unreadable(SceneError, f"Scene '{path}'", error) from None
    except UnicodeDecodeError as error:
        raise SceneError(f"Scene '{path}' cannot be read: {error}.") from None


def _set(table: dict[str, Any], key: str, value: object) -> None:
    *folders, last = key.split(".")
    for folder in folders:
        table = table.setdefault(folder, {})
        if not isinstance(cast(object, table), dict):
            raise SceneError(f"'{key}' cannot be set: '{folder}' is not a table.")
    table[last] = value


def _spec(scene: str, table: dict[str, Any], base: Path) -> SceneSpec:
    _known(scene, "", table, _KEYS)
    tables = {name: _table(scene, table, name) for name in _TABLES}
    _known(scene, "frames.", tables["frames"], _FRAMES)
    _known(scene, "calibration.", tables["calibration"], ("file", "use", *KEYS))
    _known(scene, "program.", tables["program"], ("name", "parameters"))
    keys = ("name", "device", "precision", "ranges", "fallback")
    _known(scene, "engine.", tables["engine"], keys)
    array = dict(tables["array"])
    calibration, engine = tables["calibration"], tables["engine"]
    return SceneSpec(
        name=_text(scene, table, "name", tidied(Path(scene).stem)[:LONGEST]),
        needs=_needs(scene, table),
        driver=_text(scene, array, "driver", None),
        driver_options={key: value for key, value in array.items() if key != "driver"},
        frame_range=_positive(
            scene,
            "range",
            tables["frames"].get("range"),
            "the largest magnitude in the driver's unit",
        ),
        dead=_cells(scene, tables["frames"].get("dead", [])),
        limits=_limits(scene, tables["frames"].get("limits")),
        bandwidth=_positive(
            scene, "bandwidth", tables["frames"].get("bandwidth"), "the highest frequency, Hz"
        ),
        tares=_tares(scene, tables["frames"].get("tare", [])),
        positions=_positions(scene, tables["frames"].get("positions", [])),
        reading=_reading(scene, tables["frames"]),
        pitch=_pitch(scene, tables["frames"].get("pitch")),
        calibration=_text(scene, calibration, "file", _text(scene, calibration, "use", "driver")),
        scale=_scale(scene, calibration),
        program=_text(scene, tables["program"], "name", "tactile"),
        parameters=_table(scene, tables["program"], "parameters"),
        engine=_text(scene, engine, "name", "") or None,
        device=_text(scene, engine, "device", "") or None,
        precision=_text(scene, engine, "precision", "") or None,
        ranges=_ranges(scene, engine),
        fallback=_text(scene, engine, "fallback", "") or None,
        base=base,
        events=_events(scene, table.get("event", [])),
    )


def _events(scene: str, value: object) -> tuple[EventRule, ...]:
    """Return the rules of one's own events."""
    listed = isinstance(value, list)
    tables = cast("list[object]", value) if listed else [None]
    if not all(isinstance(table, Mapping) for table in tables):
        raise SceneError(
            f"Scene '{scene}': 'event' must be a list of tables, each begun by [[event]], got "
            f"{shown(value)}."
        )
    result = enumerate(cast("list[Mapping[str, object]]", tables), 1)
    return tuple(event_rule(table, f"Scene '{scene}', event {n}") for n, table in result)


def _scale(scene: str, table: Mapping[str, Any]) -> ArrayCalibration | None:
    """Return the calibration of raw values, None if the scene says nothing of it."""
    if not table.keys() & set(KEYS):
        return None
    if table.keys() & {"file", "use"}:
        raise SceneError(
            f"Scene '{scene}': 'calibration' has both a file and its own gain, offset or "
            "tare: use one of the two."
        )
    return ArrayCalibration.of_table(table, f"Scene '{scene}'")


def _known(scene: str, prefix: str, table: Mapping[str, Any], keys: tuple[str, ...]) -> None:
    for key in table:
        if key not in keys:
            raise SceneError(f"Scene '{scene}': {name_error('key', prefix + key, keys)}")


def _table(scene: str, table: Mapping[str, Any], name: str) -> dict[str, Any]:
    value = table.get(name, {})
    if not isinstance(value, dict):
        raise SceneError(f"Scene '{scene}': '{name}' must be a table, got {shown(value)}.")
    return cast(dict[str, Any], value)


def _text(scene: str, table: Mapping[str, Any], key: str, default: str | None) -> str:
    value = table.get(key, default)
    if not isinstance(value, str):
        raise SceneError(f"Scene '{scene}': '{key}' must be a string, got {shown(value)}.")
    return value


def _ranges(scene: str, engine: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the recording that whole numbers measure their ranges on; None of none."""
    if "ranges" not in engine:
        return None
    table = _table(scene, engine, "ranges")
    _text(scene, table, "driver", None)
    return table


def _positive(scene: str, key: str, value: object, what: str) -> float | None:
    """Return a positive number of the table of frames, None if a scene says nothing."""
    if value is None:
        return None
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (number and 0.0 < cast(float, value) < math.inf):
        raise SceneError(
            f"Scene '{scene}': 'frames.{key}' must be a positive number, {what}, got {value!r}."
        )
    return float(cast(float, value))


def _limits(scene: str, value: object) -> Limits | None:
    """Return the limits of raw values, None if a scene says nothing."""
    try:
        result = cast(Limits | None, convert("frames.limits", value, Limits | None, Path()))
        several = result is not None and (not result or isinstance(result[0], tuple))
        if result is not None:
            limits_of(result, len(result) if several else 1)
    except (SceneError, ArrayError):
        raise SceneError(
            f"Scene '{scene}': 'frames.limits' must be the smallest and largest raw values of a "
            f"working taxel, as in [1, 65534], or one such pair per channel, got {value!r}."
        ) from None
    return result


def _tares(scene: str, value: object) -> tuple[float, ...]:
    """Return the times at which rest is learned anew."""
    given = cast(list[object], value if isinstance(value, list) else [value])
    times = [float(n) for n in given if isinstance(n, int | float) and not isinstance(n, bool)]
    if len(times) != len(given) or not all(0.0 <= time < math.inf for time in times):
        raise SceneError(
            f"Scene '{scene}': 'frames.tare' must be times after the first frame, s, at which "
            f"nothing touches, as in [12.5, 60.0], got {value!r}."
        )
    return tuple(times)


def _positions(scene: str, value: object) -> Positions:
    """Return the places of taxels, mm."""
    try:
        return cast(Positions, convert("frames.positions", value, Positions, Path()))
    except SceneError as error:
        raise SceneError(f"Scene '{scene}': {error}") from None


def _reading(scene: str, table: Mapping[str, Any]) -> Reading:
    """Return the order, signs and unit of the numbers of a frame."""
    keys = ("channels", "order", "flip", "unit", "time_unit")
    given = {key: table[key] for key in keys if key in table}
    try:
        return read_options(Reading, given, Path())
    except SceneError as error:
        raise SceneError(f"Scene '{scene}': 'frames': {error}") from None


def _pitch(scene: str, value: object) -> float | None:
    """Return the size of a cell, m."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if value is not None and not (number and 1e-7 <= cast(float, value) <= 1.0):
        raise SceneError(
            f"Scene '{scene}': 'frames.pitch' must be a size of cells, 1e-7 to 1 m, got {value!r}."
        )
    return None if value is None else float(cast(float, value))


def _cells(scene: str, value: object) -> tuple[tuple[int, int], ...]:
    """Return taxels as rows and columns."""
    cells = cast(list[object], value if isinstance(value, list) else [None])
    for cell in cells:
        pair = cast(list[object], cell if isinstance(cell, list) else [])
        if len(pair) != 2 or not all(type(number) is int for number in pair):
            raise SceneError(
                f"Scene '{scene}': 'frames.dead' must be a list of taxels as [row, column], got "
                f"{value!r}."
            )
    return tuple((cell[0], cell[1]) for cell in cast(list[list[int]], cells))


def _needs(scene: str, table: Mapping[str, Any]) -> tuple[str, ...]:
    value = table.get("needs", [])
    if not isinstance(value, list) or not all(
        isinstance(v, str) for v in cast(list[object], value)
    ):
        raise SceneError(
            f"Scene '{scene}': 'needs' must be a list of names, got {shown(cast(object, value))}."
        )
    return tuple(cast(list[str], value))
