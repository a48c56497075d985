"""Messages of others as arrays: MCAP files, bags of ROS 1 and ROS 2, and lines of JSON."""

import json
import warnings
from codecs import BOM_UTF8
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, fields, is_dataclass
from importlib import import_module
from importlib.util import find_spec
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from mcap.records import Message as McapMessage
from numpy.typing import NDArray

from cnnum.errors import (
    CnnumError,
    CodecError,
    RecordingError,
    RecordingWarning,
    missing_extra,
    unreadable,
)
from cnnum.recordings.mcap_chunks import SCHEMA, is_raw
from cnnum.recordings.mcap_records import PREFIX, Budget, SpentError, WholeChunk, records_in
from cnnum.recordings.reader import Hole, scan
from cnnum.safety.reading import MEGABYTE, open_regular
from cnnum.safety.values import host_bytes, shown

LINES = (".jsonl", ".ndjson", ".json")
BAGS = (".bag", ".db3")

LOG_TIME, PUBLISH_TIME = "log_time", "publish_time"
"""Names of the times of a message that are not in it."""

LONGEST_LINE, LONGEST_LIST = 16 * MEGABYTE, 64 * MEGABYTE

MOST_TOPICS = 4096

LOOKED_AT = 1 << 16
"""Bytes of a chunk in which a schema's name stands."""

XYZ = ("x", "y", "z")
STAMPS = (("sec", "nanosec"), ("secs", "nsecs"), ("seconds", "nanos"))
"""Fields of a time in messages of ROS 2, ROS 1 and Protobuf."""

FEW = 12

SPOILT = 0.5
"""Part of the messages without a field from which the field is the wrong one."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message.

    Attributes
    ----------
    topic : str
    log_time, publish_time : int, ns
        When it was recorded, and sent.
    content : callable
        Returns its fields: a mapping, or an object with attributes.
    """

    topic: str
    log_time: int
    publish_time: int
    content: Callable[[], Any]


@dataclass(slots=True)
class Topic:
    """A topic of a file.

    Attributes
    ----------
    name, kind : str
        Its name, and that of its messages' type.
    count : int
        Messages.
    """

    name: str
    kind: str
    count: int = 0


META = "metadata.yaml"
"""File in the folder of a ROS 2 bag."""


def bags_in(path: Path) -> list[Path]:
    """Return the bags of ROS 1 or ROS 2 that a path names; none where it names something else.

    A folder may be a bag of ROS 2, also one that lacks its metadata, or hold the files of a bag of
    ROS 1 that was recorded in parts, or several bags.
    """
    if not path.is_dir():
        return [path] if path.suffix.lower() in BAGS else []
    if (path / META).is_file():
        return [path]
    several = (
        [part for part in path.glob("*.bag") if part.is_file()]
        + [part.parent for part in path.glob(f"*/{META}") if part.is_file()]
    )  # fmt: skip
    return sorted(several or [part for part in path.glob("*.db3") if part.is_file()])


def is_bag(path: Path) -> bool:
    """Return whether a path names a bag of ROS 1 or ROS 2, or a folder of them."""
    return bool(bags_in(path))


def messages(path: Path, topic: str) -> Generator[Message, None, None]:
    """Yield the messages of a topic as they stand in the file; of all topics where it is "".

    Raises
    ------
    RecordingError
        If the file cannot be read.
    CodecError
        If it is none of its kind, or its messages are in an encoding that is not read.
    MissingExtraError
        If the library for them is not installed.
    """
    if is_bag(path):
        return _of_bag(path, topic)
    if path.suffix.lower() in LINES:
        return _of_lines(path)
    return _of_mcap(path, topic)


def holds_frames(path: Path) -> bool:
    """Return whether an MCAP file is a recording of cnnum, by its first whole chunk."""
    try:
        with open_regular(path) as file:
            size = file.seek(0, 2)
            for part in scan(file, size, Budget(size)):
                if isinstance(part, WholeChunk):
                    return SCHEMA.name.encode() in part.records[:LOOKED_AT] or is_raw(part.records)
    except (OSError, CodecError):
        pass
    return False


def topics(path: Path) -> dict[str, Topic]:
    """Return the topics of a file by name; it raises as `messages`."""
    result: dict[str, Topic] = {}
    with closing(messages(path, "")) as every:
        for message in every:
            kind = getattr(message.content, "kind", "")
            result.setdefault(message.topic, Topic(message.topic, kind)).count += 1
            if len(result) > MOST_TOPICS:
                raise CodecError(f"'{path}' has more than {MOST_TOPICS} topics.")
    return result


class _Later:
    """Decodes a message when it is asked for.

    Attributes
    ----------
    kind : str
        Name of its type.
    """

    __slots__ = ("_data", "_decode", "kind")

    def __init__(self, kind: str, decode: Callable[[Any], Any], data: Any) -> None:
        self.kind, self._decode, self._data = kind, decode, data

    def __call__(self) -> Any:
        return self._decode(self._data)


def _of_mcap(path: Path, topic: str) -> Generator[Message, None, None]:
    schemas: dict[int, Schema] = {}
    channels: dict[int, tuple[Channel, _Decoding]] = {}
    seen, holes = False, list[Hole]()
    try:
        with open_regular(path) as file:
            size = file.seek(0, 2)
            budget = Budget(size)
            for part in scan(file, size, budget):
                if not isinstance(part, WholeChunk):
                    holes += [part] if isinstance(part, Hole) else []
                    continue
                seen = True
                for opcode, begin, end in records_in(part.records):
                    data = part.records[begin + PREFIX.size : end]
                    if opcode == Opcode.SCHEMA:
                        schema = Schema.read(ReadDataStream(BytesIO(data)))
                        schemas[schema.id] = schema
                    elif opcode == Opcode.CHANNEL:
                        channel = Channel.read(ReadDataStream(BytesIO(data)))
                        known = channels.get(channel.id)
                        if known is None or known[0] != channel:
                            schema = schemas.get(channel.schema_id)
                            channels[channel.id] = channel, _Decoding(path, channel, schema)
                    elif opcode == Opcode.MESSAGE:
                        record = McapMessage.read(ReadDataStream(BytesIO(data)), len(data))
                        if record.channel_id not in channels:
                            raise CodecError(f"'{path}' has a message without a channel.")
                        of, decoding = channels[record.channel_id]
                        budget.take(1)
                        if topic in ("", of.topic):
                            content = _Later(decoding.kind, decoding, record.data)
                            yield Message(of.topic, record.log_time, record.publish_time, content)
    except OSError as error:
        if isinstance(error, CnnumError):
            raise
        raise unreadable(RecordingError, f"'{path}'", error) from None
    except SpentError as error:
        raise CodecError(f"'{path}' is refused: {error}.") from None
    except (CodecError, MemoryError):
        raise
    except Exception as error:  # whatever the library finds in a damaged record
        raise CodecError(f"'{path}' is damaged: {_said(error)}.") from None
    if not seen:
        raise CodecError(f"'{path}' is not an MCAP file, or has no complete message.")
    if holes:
        warnings.warn(
            f"'{path}' is damaged: {unreadable_bytes(holes)} bytes in {len(holes)} places are not "
            "readable, and the messages in them are missing.",
            RecordingWarning,
            stacklevel=2,
        )


def unreadable_bytes(holes: Iterable[Hole]) -> int:
    """Return the bytes of holes."""
    return sum(hole.end - hole.start for hole in holes)


def holes_in(path: Path) -> list[Hole]:
    """Return the stretches of an MCAP file that are not readable; none of a bag's."""
    if is_bag(path):
        return []
    try:
        with open_regular(path) as file:
            size = file.seek(0, 2)
            return [part for part in scan(file, size, Budget(size)) if isinstance(part, Hole)]
    except OSError as error:
        raise unreadable(RecordingError, f"'{path}'", error) from None


class _Decoding:
    """The way from the bytes of a channel's messages to their fields."""

    def __init__(self, path: Path, channel: Channel, schema: Schema | None) -> None:
        self._path, self._channel, self._schema = path, channel, schema
        self.kind = schema.name if schema is not None else channel.message_encoding
        self._decode: Callable[[bytes], Any] | None = None

    def __call__(self, data: bytes) -> Any:
        """Return the fields of a message."""
        if self._decode is None:
            self._decode = self._found()
        try:
            return self._decode(data)
        except Exception as error:  # whatever a decoder finds in bytes of others
            raise CodecError(
                f"'{self._path}': a message of '{self._channel.topic}' is not a valid "
                f"'{self.kind}': {_said(error)}."
            ) from None

    def _found(self) -> Callable[[bytes], Any]:
        encoding = self._channel.message_encoding
        if encoding == "json":
            return json.loads
        ways = {
            "cdr": ("mcap_ros2.decoder", "mcap-ros2-support", "ROS 2"),
            "protobuf": ("mcap_protobuf.decoder", "mcap-protobuf-support", "Protobuf"),
        }
        if encoding not in ways:
            raise CodecError(
                f"'{self._path}': the messages of '{self._channel.topic}' are in {encoding!r:.40}, "
                "expected 'json', 'cdr' (ROS 2) or 'protobuf'."
            )
        module, library, what = ways[encoding]
        if find_spec(module.partition(".")[0]) is None:
            raise missing_extra(f"{what} messages in '{self._path.name}'", library, "bags")
        try:
            factory: Any = import_module(module).DecoderFactory()
            result: Any = factory.decoder_for(encoding, self._schema)
        except Exception as error:  # a schema that is damaged
            raise CodecError(
                f"'{self._path}': the schema '{self.kind}' cannot be read: {_said(error)}."
            ) from None
        if result is None:
            raise CodecError(f"'{self._path}': there is no schema for '{self._channel.topic}'.")
        return cast("Callable[[bytes], Any]", result)


def _of_bag(path: Path, topic: str) -> Generator[Message, None, None]:
    if find_spec("rosbags") is None:
        raise missing_extra(f"the bag '{path.name}'", "rosbags", "bags")
    bags = bags_in(path)
    if len({bag.suffix.lower() == ".bag" for bag in bags}) > 1:
        some = ", ".join(f"'{bag.name}'" for bag in bags[:FEW])
        raise CodecError(
            f"'{path}' contains bags of ROS 1 and of ROS 2 ({some}): name one of them."
        )
    for bag in bags:
        for file in [bag] if bag.is_file() else sorted(bag.glob("*")):
            if file.is_file():
                open_regular(file).close()  # refuses a pointer to data that is not here
    reading: Any = import_module("rosbags.highlevel")
    types: Any = import_module("rosbags.typesys")
    try:
        usual = types.get_typestore(types.Stores.LATEST)
        with reading.AnyReader(bags, default_typestore=usual) as reader:
            wanted = [link for link in reader.connections if topic in ("", link.topic)]
            if not wanted:
                return
            for connection, when, data in reader.messages(connections=wanted):

                def decode(raw: Any, kind: str = connection.msgtype) -> Any:
                    try:
                        return reader.deserialize(raw, kind)
                    except Exception as error:
                        raise CodecError(
                            f"'{path}': a message is not a valid '{kind}': {_said(error)}."
                        ) from None

                content = _Later(connection.msgtype, decode, data)
                yield Message(connection.topic, int(when), int(when), content)
    except OSError as error:
        if isinstance(error, CnnumError):
            raise
        raise unreadable(RecordingError, f"'{path}'", error) from None
    except (CnnumError, MemoryError):
        raise
    except Exception as error:  # whatever the library finds in a damaged bag
        raise CodecError(f"'{path}' cannot be read as a bag: {_said(error)}.") from None


def _of_lines(path: Path) -> Generator[Message, None, None]:
    number = 0
    try:
        with open_regular(path) as file:
            if (listed := _listed(file)) is not None:
                for number, item in enumerate(listed, 1):
                    yield Message("", number, number, _Later("JSON", _itself, item))
                return
            while line := file.readline(LONGEST_LINE):
                number += 1
                if line.strip():
                    content = _Later("JSON", json.loads, line)
                    yield Message("", number, number, _checked(path, number, content))
    except OSError as error:
        if isinstance(error, CnnumError):
            raise
        raise unreadable(RecordingError, f"'{path}'", error) from None


def _itself(content: Any) -> Any:
    return content


def _listed(file: IO[bytes]) -> list[object] | None:
    """Return the messages of a file that is one list of them, or None if it has lines."""
    begin = file.read(LOOKED_AT)
    file.seek(0)
    if begin.removeprefix(BOM_UTF8).lstrip()[:1] != b"[" or b"{" not in begin:
        return None
    held: object = None
    with suppress(ValueError, RecursionError):
        held = json.loads(file.read(LONGEST_LIST))
    file.seek(0)
    if not isinstance(held, list) or not held:
        return None
    listed = cast("list[object]", held)
    return listed if all(isinstance(item, dict) for item in listed) else None


def _checked(path: Path, line: int, content: _Later) -> _Later:
    def decode(_: None) -> Any:
        try:
            return content()
        except (ValueError, RecursionError) as error:
            said = _said(error)
            raise CodecError(f"'{path}', line {line}: expected JSON: {said}.") from None

    return _Later("JSON", decode, None)


def field_arrays(path: Path, topic: str, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Return fields of all messages of a topic as arrays, one row per message.

    Parameters
    ----------
    path : Path
    topic : str
        May be "" where the file has but one.
    names : sequence of str
        Fields, with dots between a field and those in it: "taxels.force". A list of messages gives
        a list of their fields. `LOG_TIME` and `PUBLISH_TIME` are those of the message.

    Returns
    -------
    dict of str to array
        Times of messages are s; the others have the shape of the field. The messages are sorted by
        their log times; "order" is False where they did not stand so. Where a few messages lack a
        field, or have it in another shape, it is NaN; those that lack a time are left out. Both are
        said.

    Raises
    ------
    CodecError
        If there is no such topic or field, or most messages have it in no shape that they share;
        else as `messages`.
    """
    rows: list[tuple[int, list[Any]]] = []
    faults: list[CodecError] = []
    count = 0
    kinds: set[str] = set()
    held, room = 0, host_bytes()
    with closing(messages(path, topic)) as every:
        for message in every:
            kinds.add(message.topic)
            if len(kinds) > 1:
                raise CodecError(
                    f"'{path}' has several topics: name one with 'topic', as in {_few(kinds)}."
                )
            count += 1
            row: list[Any] = []
            try:
                content = message.content()
            except CodecError as error:
                faults.append(error)
                continue
            for name in names:
                try:
                    row.append(_value(path, message, content, name))
                except CodecError as error:
                    faults += [error] if all(part is not None for part in row) else []
                    row.append(None)
            rows.append((message.log_time, row))
            held += sum(getattr(part, "nbytes", 8) for part in row)
            if room is not None and 2 * held > room:
                raise RecordingError(
                    f"'{path}' contains more numbers than fit into the memory of this machine."
                )
    if faults and len(faults) >= SPOILT * count:
        raise faults[0]
    if not rows:
        there = ", ".join(f"'{name}'" for name in list(topics(path))[:FEW]) or "none"
        raise CodecError(f"'{path}' has no message of the topic {shown(topic)}; it has {there}.")
    times = [when for when, _ in rows]
    ordered = all(b >= a for a, b in pairwise(times))
    if not ordered:
        rows.sort(key=lambda row: row[0])
    for place in range(len(names)):  # without its time a message has no place
        if any(isinstance(row[place], int) for _, row in rows):
            rows = [(when, row) for when, row in rows if row[place] is not None]
    result: dict[str, NDArray[Any]] = {"order": np.array(ordered)}
    for place, name in enumerate(names):
        column = [row[place] for _, row in rows]
        if name in (LOG_TIME, PUBLISH_TIME) or isinstance(column[0], int):
            result[name] = 1e-9 * (np.array(column, np.int64) - column[0])
            continue
        shapes = Counter(part.shape for part in column if part is not None)
        (usual, often), *others = shapes.most_common()
        if others and len(column) - often >= SPOILT * len(column):
            raise CodecError(
                f"'{path}': the field '{name}' has {len(shapes)} shapes, such as "
                f"{_few(set(shapes))}; expected one."
            )
        faults += [
            CodecError(
                f"'{path}': the field '{name}' of a message has the shape {part.shape}, expected "
                f"{usual}."
            )
            for part in column
            if part is not None and part.shape != usual
        ]
        missing = np.full(usual, np.nan)
        result[name] = np.stack(
            [missing if part is None or part.shape != usual else part for part in column]
        )
    if faults:
        warnings.warn(
            f"{len(faults)} of {count} messages are bad, and their frames are missing or contain "
            f"no numbers; the first: {faults[0]}",
            RecordingWarning,
            stacklevel=2,
        )
    return result


def _few(kinds: set[Any]) -> str:
    return ", ".join(f"'{kind}'" for kind in sorted(map(str, kinds))[:FEW])


def _value(path: Path, message: Message, content: Any, name: str) -> Any:
    """Return a field: an array, or ns of a time."""
    if name == LOG_TIME:
        return message.log_time
    if name == PUBLISH_TIME:
        return message.publish_time
    try:
        whole = not name and "values" in names_of(content)
        value = part_of(content, "values" if whole else name)
    except LookupError as error:
        there = ", ".join(names_of(content)[:FEW]) or "none"
        raise CodecError(
            f"'{path}': a message has no field {shown(name)} ({error}); it has {there}."
        ) from None
    stamp = next((pair for pair in STAMPS if names_of(value) == list(pair)), None)
    if stamp:
        seconds, nanos = (int(_child(value, part)) for part in stamp)
        return seconds * 1_000_000_000 + nanos
    try:
        return numbers_of(value)
    except (TypeError, ValueError, OverflowError):
        raise CodecError(
            f"'{path}': the field {shown(name)} of a message does not contain numbers of one shape."
        ) from None


def part_of(content: Any, name: str) -> Any:
    """Return a field of a message by its path.

    Raises
    ------
    LookupError
        If there is no such name.
    """
    for part in name.split(".") if name else ():
        if _is_list(content):
            content = [_child(item, part) for item in content]
        else:
            content = _child(content, part)
    return content


def _child(content: Any, name: str) -> Any:
    if isinstance(content, Mapping):
        held = cast("Mapping[str, Any]", content)
        if name in held:
            return held[name]
    elif name in names_of(content):
        return getattr(content, name)
    raise LookupError(f"no '{name:.60}'")


def names_of(content: Any) -> list[str]:
    """Return the fields of a message."""
    if isinstance(content, Mapping):
        held = cast("Mapping[object, object]", content)
        return [str(key) for key in held]
    if hasattr(content, "DESCRIPTOR"):  # Protobuf
        return [str(field.name) for field in content.DESCRIPTOR.fields]
    if is_dataclass(content):
        return [field.name for field in fields(content) if not field.name.startswith("_")]
    slots: Any = getattr(type(cast(object, content)), "__slots__", ())
    return [str(name) for name in slots if not str(name).startswith("_")]


def _is_list(value: Any) -> bool:
    if isinstance(value, str | bytes | Mapping) or hasattr(value, "DESCRIPTOR"):
        return False
    return hasattr(value, "__len__") and hasattr(value, "__getitem__")


def numbers_of(value: Any) -> NDArray[np.float64]:
    """Return the numbers of a field, in its shape; those of vectors as x, y, z.

    Raises
    ------
    TypeError, ValueError
        If there are others than numbers, or lists of several lengths.
    """
    kind = type(cast(object, value))
    if kind is np.ndarray:
        array = cast("NDArray[Any]", value)
        if array.dtype.kind in "fiub":
            return array.astype(np.float64)
    if value is None:
        return np.array(np.nan)
    if issubclass(kind, bool | int | float):
        return np.array(float(value))
    if issubclass(kind, bytes | bytearray | memoryview):
        return np.frombuffer(bytes(value), np.uint8).astype(np.float64)
    if _is_list(value):
        parts = [numbers_of(item) for item in value]
        return np.stack(parts) if parts else np.zeros(0)
    names = names_of(value)
    axes = [name for name in XYZ if name in names] or names
    if not axes:
        raise TypeError(kind.__name__)
    return np.concatenate([numbers_of(_child(value, name)).ravel() for name in axes])


def numeric_fields(content: Any, prefix: str = "", depth: int = 4) -> Iterator[tuple[str, Any]]:
    """Yield the paths of fields that hold several numbers, and their shapes."""
    try:
        value = numbers_of(content)
        if prefix and value.size > 1:
            yield prefix, value.shape
    except (TypeError, ValueError, LookupError, OverflowError):
        pass
    if not depth:
        return
    inner = content[0] if _is_list(content) and len(content) else content
    for name in names_of(inner):
        path = f"{prefix}.{name}" if prefix else name
        try:
            part = part_of(content, name)
        except LookupError:
            continue
        if not isinstance(part, str | bytes):
            yield from numeric_fields(part, path, depth - 1)


def _said(error: Exception) -> str:
    text = "".join(sign if sign.isprintable() else " " for sign in str(error))
    return " ".join(text.split())[:200].rstrip(".") or type(error).__name__
