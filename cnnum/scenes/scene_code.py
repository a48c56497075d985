"""What of a scene is around its program, as C: the calibration of raw frames, the event rules."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.embedded.c.files import MANIFEST, Exported, identifier
from cnnum.embedded.c.text import literal, table_lines
from cnnum.embedded.formats import Format
from cnnum.embedded.program import Array, array_names
from cnnum.scenes.conversion import AsRead, ByArrayCalibration, ByCalibration, Conversion
from cnnum.scenes.events import EventRule

WEIGHT_BITS = 24
"""Bits of a gain, with its sign: as the weights of programs have at most."""

OFFSET_PLACES = 8
"""Fraction bits of an offset beyond those of raw values: a mean over a tare is no whole number."""

RAW_PLACES = 20
"""Fraction bits of raw values that are no counts, such as volts."""

LARGEST_RAW = 1 << 27
"""Raw values are limited to this: sums of products then fit in 64 bits."""


def with_scene(
    exported: Exported,
    conversion: Conversion,
    channels: Sequence[str],
    raw_unit: str,
    rules: Sequence[EventRule],
    rate: float,
) -> Exported:
    """Return an export whose C also calibrates raw frames and turns answers into events.

    Parameters
    ----------
    exported : Exported
    conversion : Conversion
        From raw frames to the program's channels.
    channels : sequence of str
        Channels of a raw frame, in their order.
    raw_unit : str
        Unit of raw values; those that are no counts have `RAW_PLACES` fraction bits.
    rules : sequence of EventRule
    rate : float, Hz
        Frame rate, by which times of rules become frames.
    """
    header, source, record = list[str](), list[str](), dict[str, object]()
    linear = _linear(conversion, channels, exported)
    if linear is not None:
        places = 0 if raw_unit in ("", "count") or exported.program.real else RAW_PLACES
        parts = _Calibration(exported, linear, places, channels, raw_unit).text()
        if parts is not None:
            header, source = [*header, *parts[0]], [*source, *parts[1]]
            record["raw"] = {
                "channels": list(channels),
                "unit": raw_unit,
                "fraction": places,
                "tare": linear.tare,
            }
    if not source:
        header += ["/* The calibration changes with time: the firmware has to apply it. */", ""]
    if rules:
        lines = _Events(exported, rules, rate)
        header, source = [*header, *lines.header()], [*source, *lines.source()]
        record["events"] = list(lines.kinds)
    return _appended(exported, header, source, record)


def _appended(
    exported: Exported, header: Sequence[str], source: Sequence[str], record: Mapping[str, object]
) -> Exported:
    name, files = identifier(exported.program.name), dict(exported.files)
    close = "#ifdef __cplusplus\n}\n#endif\n"
    before, after = files[f"{name}.h"].rsplit(close, 1)
    files[f"{name}.h"] = before + "\n".join([*header, ""]) + close + after
    files[f"{name}.c"] += "\n".join(["", *source, ""])
    manifest = json.loads(files[MANIFEST]) | dict(record)
    files[MANIFEST] = json.dumps(manifest, indent=1, ensure_ascii=False) + "\n"
    return replace(exported, files=files)


@dataclass(frozen=True, slots=True, eq=False)
class _Linear:
    """value = gain · (raw − offset), with the mean of the first `tare` frames as offset if any.

    Attributes
    ----------
    gain : (cells or 1, wanted, raw) float
    offset : (cells or 1, raw) float
    tare : int
    wanted : tuple of str
        Channels of the program that it gives.
    """

    gain: Floats
    offset: Floats
    tare: int
    wanted: tuple[str, ...]


def _linear(conversion: Conversion, channels: Sequence[str], exported: Exported) -> _Linear | None:
    """Return a conversion as gains and offsets, or None if it changes with time."""
    record: dict[str, Any] = json.loads(exported.files[MANIFEST])
    wanted = tuple(part["name"] for part in record["inputs"] if part["name"] in conversion.channels)
    places, count = [conversion.channels.index(name) for name in wanted], len(channels)
    if isinstance(conversion, ByCalibration):
        calibration = conversion.calibration
        if calibration.wanders:
            return None
        weights = np.asarray(calibration.strain_weights(wanted))
        gain, offset = weights.reshape(-1, len(wanted), count), calibration.offsets
        return _Linear(gain, np.asarray(offset).reshape(-1, count), 0, wanted)
    if isinstance(conversion, ByArrayCalibration):
        scale = conversion.calibration
        form = scale.form(conversion.shape, count)
        if form in ("matrix", "matrices"):
            gain = scale.gain.reshape(-1, count, count)[:, places]
        else:
            factors = np.broadcast_to(scale.gain, (*scale.gain.shape[:-1], count)).reshape(
                -1, count
            )
            gain = (factors[:, :, np.newaxis] * np.eye(count))[:, places]
        offset = np.broadcast_to(scale.offset, (*scale.offset.shape[:-1], count))
        return _Linear(gain, offset.reshape(-1, count), scale.tare, wanted)
    assert isinstance(conversion, AsRead)
    return _Linear(np.eye(count)[np.newaxis, places], np.zeros((1, count)), 0, wanted)


@dataclass(frozen=True, slots=True)
class _Calibration:
    """The text of a calibration."""

    exported: Exported
    linear: _Linear
    places: int
    channels: Sequence[str]
    unit: str

    def text(self) -> tuple[list[str], list[str]] | None:
        """Return the lines of header and source, or None if the numbers have no common format."""
        body = self._real() if self.exported.program.real else self._whole()
        if body is None:
            return None
        name, kind = identifier(self.exported.program.name), self._kind
        takes = f"const {kind} *raw, {name}_input *in"
        if self.linear.tare:
            takes = f"{name}_tare *tare, {takes}"
        unit = f", {self.unit}" if self.unit else ""
        places = f", times 2^-{self.places}" if self.places else ""
        header = [
            f"#define {name.upper()}_CHANNELS {len(self.channels)}",
            *self._state(name, kind),
            f"/* from a raw frame{unit}{places}, row by row, in each cell",
            f"   {', '.join(self.channels)}; returns how many inputs lay beyond their ranges */",
            f"uint32_t {name}_calibrate({takes});",
            "",
        ]
        return header, [*body[0], f"uint32_t {name}_calibrate({takes})", "{", *body[1], "}", ""]

    @property
    def _kind(self) -> str:
        return "float" if self.exported.program.real else "int32_t"

    @property
    def _cells(self) -> int:
        rows, cols = self.exported.program.shape
        return rows * cols

    def _state(self, name: str, kind: str) -> list[str]:
        count, many = self._cells * len(self.channels), self.linear.tare
        if not many:
            return []
        total = "float" if kind == "float" else "int64_t"
        return [
            f"/* the mean of the first {many} frames is the offset; all 0 before them */",
            f"typedef struct {{ {total} sum[{count}]; {kind} offset[{count}]; uint32_t frames; }} "
            f"{name}_tare;",
        ]

    def _tares(self, mean: str) -> list[str]:
        if not self.linear.tare:
            return []
        return [
            f"    if (tare->frames < {self.linear.tare}u) {{",
            "        ++tare->frames;",
            f"        for (int32_t k = 0; k < {self._cells * len(self.channels)}; ++k) {{",
            "            tare->sum[k] += raw[k];",
            f"            tare->offset[k] = {mean};",
            "        }",
            "    }",
        ]

    def _members(self) -> list[Array]:
        record: dict[str, Any] = json.loads(self.exported.files[MANIFEST])
        arrays = {part["name"]: part["member"] for part in record["inputs"]}
        return [self.exported.program.arrays[arrays[name]] for name in self.linear.wanted]

    def _place(self, values: Floats, index: str) -> str:
        """Return the place of a number in a table that has all cells, or one for all."""
        per_cell = int(values[0].size)
        start = f"i * {per_cell} + " if len(values) > 1 else ""
        return start + index

    def _real(self) -> tuple[list[str], list[str]]:
        linear, count = self.linear, len(self.channels)
        tables = [
            Array(
                f"calibration_{part}", "table", values.size, None, f"{part} of raw values", values
            )
            for part, values in (("gain", linear.gain), ("offset", linear.offset))
        ]
        offset = f"calibration_offset[{self._place(linear.offset, 'k')}]"
        if linear.tare:
            offset, tables = f"tare->offset[i * {count} + k]", tables[:1]
        body = [
            *self._tares("tare->sum[k] / (float)tare->frames"),
            f"    for (int32_t i = 0; i < {self._cells}; ++i) {{",
        ]
        for row, member in enumerate(self._members()):
            gain = f"calibration_gain[{self._place(linear.gain, f'{row * count} + k')}]"
            body += [
                "        {",
                "            float sum = 0.0f;",
                f"            for (int32_t k = 0; k < {count}; ++k) {{",
                f"                sum += {gain} * (raw[i * {count} + k] - {offset});",
                "            }",
                f"            in->{member.name}[i] = sum;",
                "        }",
            ]
        lines = [line for table in tables for line in (*table_lines(table, "static const"), "")]
        return lines, [*body, "    }", "    return 0u;"]

    def _whole(self) -> tuple[list[str], list[str]] | None:
        linear, count = self.linear, len(self.channels)
        weight = WEIGHT_BITS - 1 - _places_of(linear.gain)
        largest = 0 if linear.tare else _places_of(linear.offset)
        places = min(self.places + OFFSET_PLACES, 30 - largest)
        members = self._members()
        shifts = [weight + places - member.format.fraction for member in members if member.format]
        if places < self.places or not all(0 < shift < 62 for shift in shifts):
            return None
        tables = [
            Array(
                f"calibration_{part}", "table", values.size, Format(32, fraction),
                f"{part} of raw values: times 2^{-fraction}",
                np.floor(np.ldexp(values, fraction) + 0.5).astype(np.int64),
            )
            for part, values, fraction in (
                ("gain", linear.gain, weight), ("offset", linear.offset, places)
            )
        ]  # fmt: skip
        offset = f"calibration_offset[{self._place(linear.offset, 'k')}]"
        if linear.tare:
            offset, tables = f"tare->offset[i * {count} + k]", tables[:1]
        scale = 1 << (places - self.places)
        body = [
            "    uint32_t beyond = 0u;",
            *self._tares(f"(int32_t)nearest(tare->sum[k] * {scale}, (int64_t)tare->frames)"),
            f"    for (int32_t i = 0; i < {self._cells}; ++i) {{",
        ]
        for row, (member, shift) in enumerate(zip(members, shifts, strict=True)):
            assert member.bounds is not None
            gain = f"calibration_gain[{self._place(linear.gain, f'{row * count} + k')}]"
            least, most = (literal(member, end) for end in member.bounds)
            store = f"(int{member.bits}_t)" if member.bits < 32 else "(int32_t)"
            body += [
                "        {",
                "            int64_t sum = 0;",
                f"            for (int32_t k = 0; k < {count}; ++k) {{",
                f"                const int64_t value = kept(raw[i * {count} + k]);",
                f"                sum += {gain} * (value * {scale} - {offset});",
                "            }",
                f"            sum = (sum + ((int64_t)1 << {shift - 1})) >> {shift};",
                f"            beyond += sum < {least} || sum > {most} ? 1u : 0u;",
                f"            in->{member.name}[i] = {store}(sum < {least} ? {least} : "
                f"sum > {most} ? {most} : sum);",
                "        }",
            ]
        lines = [line for table in tables for line in (*table_lines(table, "static const"), "")]
        if linear.tare:
            lines += [*_NEAREST, ""]
        lines += [*_KEPT, ""]
        return lines, [*body, "    }", "    return beyond;"]


_NEAREST = [
    "static int64_t nearest(int64_t a, int64_t b)",
    "{",
    "    const int64_t half = a < 0 ? -(b / 2) : b / 2;",
    "    return (a + half) / b;",
    "}",
]
_KEPT = [
    "/* raw values beyond this would not fit the sums */",
    "static int64_t kept(int32_t raw)",
    "{",
    f"    const int32_t most = {LARGEST_RAW};",
    "    return raw < -most ? -most : raw > most ? most : raw;",
    "}",
]


def _places_of(values: Floats) -> int:
    """Return the bits before the point that the largest of some numbers takes."""
    largest = float(np.abs(values).max(initial=0.0))
    return math.frexp(largest)[1] if largest else 0


@dataclass(frozen=True, slots=True)
class _Events:
    """The text of event rules."""

    exported: Exported
    rules: Sequence[EventRule]
    rate: float

    @property
    def name(self) -> str:
        """The program's name in C."""
        return identifier(self.exported.program.name)

    @property
    def kinds(self) -> dict[str, int]:
        """The numbers of events by their names."""
        titles = [title for rule in self.rules for title in (_title(rule), rule.ends) if title]
        return {title: number for number, title in enumerate(dict.fromkeys(titles), 1)}

    def _constants(self) -> dict[str, str]:
        """Return the constants of C by the names of events."""
        return {k: v.upper() for k, v in array_names(f"{self.name}_event", self.kinds).items()}

    def _array(self, output: str) -> Array:
        program = self.exported.program
        return program.arrays[program.outputs[output]]

    def header(self) -> list[str]:
        """Return the lines of the header."""
        name, constants, kind = self.name, self._constants(), self._number
        return [
            *(f"#define {constants[title]} {number}" for title, number in self.kinds.items()),
            f"#define {name.upper()}_EVENTS {len(self.rules)}",
            "",
            "/* What has begun or ended; numbers have the fractions of their outputs:",
            *(f"   {line}" for rule in self.rules for line in self._sources(rule)),
            "*/",
            "typedef struct {",
            f"    {kind} row, column; /* where, if has_place */",
            f"    {kind} x, y; /* which way, if has_direction */",
            f"    {kind} strength; /* if has_strength */",
            "    uint8_t kind; /* one of the numbers above */",
            "    uint8_t has_place, has_direction, has_strength;",
            "    uint8_t pivots; /* a slip that turns */",
            "    uint8_t is_bound; /* the strength is a load, and a lower bound of it */",
            "    int8_t sense; /* -1, 0 or 1 */",
            f"}} {name}_event;",
            "",
            "typedef struct { /* all 0 before the first frame */",
            f"    uint32_t waited[{len(self.rules)}];",
            f"    uint8_t held[{len(self.rules)}], above[{len(self.rules)}];",
            f"}} {name}_event_state;",
            "",
            f"/* the events of a frame, {name.upper()}_EVENTS at most; saturated: whether a taxel",
            "   stands at an end of its range. Returns how many there are. */",
            f"uint32_t {name}_events({name}_event_state *s, const {name}_output *out,",
            f"    uint8_t saturated, {name}_event *events);",
            "",
        ]

    def _sources(self, rule: EventRule) -> list[str]:
        where, way = " ".join(rule.where or ()), " ".join(rule.direction or ())
        parts = (("place", where), ("direction", way), ("strength", rule.strength))
        known = ", ".join(f"{part} {of}" for part, of in parts if of)
        return [f"{_title(rule)}: {known or rule.flag}"]

    @property
    def _number(self) -> str:
        return "float" if self.exported.program.real else "int32_t"

    def source(self) -> list[str]:
        """Return the lines of the source."""
        name, lines = self.name, list[str]()
        maps = {
            output for rule in self.rules for output in rule.needs if self._array(output).length
        }
        for output in sorted(maps):
            lines += [*self._largest(output), ""]
        body = [line for place, rule in enumerate(self.rules) for line in self._rule(place, rule)]
        return [
            *lines,
            f"uint32_t {name}_events({name}_event_state *s, const {name}_output *out,",
            f"    uint8_t saturated, {name}_event *events)",
            "{",
            "    uint32_t count = 0u;",
            "    (void)saturated;",
            *body,
            "    return count;",
            "}",
            "",
        ]

    def _largest(self, output: str) -> list[str]:
        """Return a function that finds the place of a map's largest number."""
        array = self._array(output)
        return [
            f"static int32_t place_of_{array.name}(const {self.name}_output *out)",
            "{",
            "    int32_t place = 0;",
            f"    for (int32_t i = 1; i < {array.length}; ++i) {{",
            f"        place = out->{array.name}[i] > out->{array.name}[place] ? i : place;",
            "    }",
            "    return place;",
            "}",
        ]

    def _value(self, output: str) -> str:
        """Return an output's number; of a map the largest."""
        array = self._array(output)
        at = f"[place_of_{array.name}(out)]" if array.length else ""
        return f"({self._number})out->{array.name}{at}"

    def _level(self, output: str, level: float) -> str:
        """Return the number above which an output is above a level."""
        array = self._array(output)
        if array.format is None and not array.logic:
            single = np.float32(level)
            if float(single) > level:
                single = np.nextafter(single, np.float32(-np.inf))
            return literal(array, float(single))
        fraction = 0 if array.format is None else array.format.fraction
        whole = math.floor(math.ldexp(level, fraction))
        number = max(-(1 << 31) + 1, min((1 << 31) - 1, whole))
        return f"{float(number)}f" if self.exported.program.real else str(number)

    def _rule(self, place: int, rule: EventRule) -> list[str]:
        on, off = self._level(rule.flag, rule.on), self._level(rule.flag, rule.off)
        lines = [
            f"    {{ /* {_title(rule)} */",
            f"        const {self._number} flag = {self._value(rule.flag)};",
            f"        uint8_t now = flag > (s->above[{place}] ? {off} : {on}) ? 1u : 0u;",
            f"        s->above[{place}] = now;",
        ]
        if rule.shape:
            lines.append(f"        now = saturated ? s->held[{place}] : now;")
        elif rule.load:
            lines.append(f"        now = saturated && s->held[{place}] ? 1u : now;")
        if rule.steady > 0.0:
            wait = math.ceil(rule.steady * (1 - 1e-9) * self.rate)
            lines += [
                f"        if (now != s->held[{place}] && s->waited[{place}] < {wait}u) {{",
                f"            ++s->waited[{place}];",
                f"            now = s->held[{place}];",
                "        } else {",
                f"            s->waited[{place}] = 0u;",
                "        }",
            ]
        ends = "" if rule.ends else " && now"
        lines += [
            f"        if (now != s->held[{place}]{ends}) {{",
            *(f"            {line}" for line in self._filled(rule)),
            "        }",
            f"        s->held[{place}] = now;",
            "    }",
        ]
        return lines

    def _filled(self, rule: EventRule) -> list[str]:
        constants = self._constants()
        kind = constants[_title(rule)]
        if rule.ends:
            kind = f"now ? {kind} : {constants[rule.ends]}"
        lines = [
            f"{self.name}_event *e = events + count++;",
            f"static const {self.name}_event nothing = {{0}};",
            "*e = nothing;",
            f"e->kind = (uint8_t)({kind});",
        ]
        if rule.pivots:
            lines.append(f"e->pivots = {self._value(rule.pivots)} > 0 ? 1u : 0u;")
        if rule.where is not None:
            row, column = (self._value(output) for output in rule.where)
            lines += ["e->has_place = 1u;", f"e->row = {row};", f"e->column = {column};"]
        elif self._array(rule.flag).length:
            cols, at = (
                self.exported.program.shape[1],
                f"place_of_{self._array(rule.flag).name}(out)",
            )
            lines += [
                "e->has_place = 1u;",
                f"e->row = ({self._number})({at} / {cols});",
                f"e->column = ({self._number})({at} % {cols});",
            ]
        if rule.centred:
            lines.append(f"e->has_place = {self._value(rule.centred)} > 0 ? e->has_place : 0u;")
        began = list[str]()
        if rule.direction is not None:
            x, y = (self._value(output) for output in rule.direction)
            began += ["e->has_direction = 1u;", f"e->x = {x};", f"e->y = {y};"]
        if rule.strength:
            began += ["e->has_strength = 1u;", f"e->strength = {self._value(rule.strength)};"]
            if rule.load:
                began.append("e->is_bound = saturated ? 1u : 0u;")
        if rule.sense:
            turns = self._value(rule.sense)
            only = "e->pivots && " if rule.pivots else ""
            began.append(
                f"e->sense = (int8_t)({only}{turns} > 0 ? 1 : {only}{turns} < 0 ? -1 : 0);"
            )
        if began:
            lines += ["if (now) {", *(f"    {line}" for line in began), "}"]
        return lines


def _title(rule: EventRule) -> str:
    return f"{rule.phase}_{rule.kind}" if rule.phase else rule.kind
