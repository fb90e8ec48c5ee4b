"""Reading our recordings in MCAP, also those that were cut off or damaged.

Where the messages are is known from a scan; their values are read when asked.
"""

from __future__ import annotations

import json
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from heapq import merge
from itertools import count, repeat
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, InvalidArrayError, SkinError
from skinmap.io.mcap.mcap_scan import (
    CONTENT,
    DAMAGED,
    MESSAGE_HEAD,
    WHOLE,
    Place,
    Scan,
    read_chunk,
    scan,
    scan_index,
)
from skinmap.io.mcap.mcap_scan import HEAD as HEAD_OF_RECORD
from skinmap.io.mcap.writing import (
    FORMAT,
    METADATA,
    REPAIRED,
    TABLES,
    TOPICS,
    TOUCHES,
    McapWriter,
    mark_text,
)
from skinmap.io.output import refused
from skinmap.io.recordings.recorded_stream import (
    NS,
    OVERVIEW,
    Kind,
    Loss,
    MarkedTouch,
    Overview,
    RecordedStream,
    StreamInfo,
    measured_rate,
    nanoseconds_of,
    overview_of,
    rate_by_times,
    seconds_of,
)
from skinmap.io.ros2 import messages as ros2
from skinmap.io.ros2.messages import read_joints, read_text, text_message
from skinmap.io.ros2.robot_topics import JOINT_STATES, LATCHED
from skinmap.io.taxels.taxel_table import parse_csv
from skinmap.skin.taxels import TaxelTable
from skinmap.touch.recording import TrueMotion

KEPT = 8  # chunks kept unfolded: each of some players comes by each of them once


class Messages:
    """Where the messages of one channel are: five numbers each, however long they are."""

    def __init__(self) -> None:
        self.times, self.samples = array("Q"), array("I")
        self.chunks, self.offsets, self.lengths = array("I"), array("I"), array("I")

    def __len__(self) -> int:
        return len(self.times)

    def order(self) -> IntArray:
        """Rows in the order of their times; those of one time as they were written."""
        return np.argsort(np.frombuffer(self.times, np.uint64), kind="stable")


class Index:
    """All messages of a file by channel, and its chunks.

    Parameters
    ----------
    path : Path
    trusted : bool
        Believe the file's own index where the file proves to be whole: lengths and numbers of
        messages are then not known, and their bytes not looked at.
    """

    def __init__(self, path: Path, *, trusted: bool = False) -> None:
        self.channels: dict[int, Messages] = {}
        self.chunks: list[Place] = []
        self.path = path
        whole = scan_index(path) if trusted else None
        if whole is None:
            self.found = scan(path, self._take)
            missing = self.found.stated - sum(map(len, self.channels.values()))
            if missing > 0 and not self.found.damage:  # a bit turned a record into another kind
                self.found.damage.append(f"{missing} messages fewer than the file states")
            return
        self.found, self.chunks, places = whole
        for channel, (pairs, chunks) in places.items():
            messages, count = Messages(), len(pairs)
            self.channels[channel] = messages
            messages.times.frombytes(pairs[:, 0].tobytes())
            messages.samples.frombytes(np.arange(count, dtype=np.uint32).tobytes())
            messages.chunks.frombytes(chunks.tobytes())
            messages.offsets.frombytes(pairs[:, 1].astype(np.uint32).tobytes())
            messages.lengths.frombytes(bytes(4 * count))

    def _take(
        self, channel: int, sample: int, time: int, offset: int, length: int, place: Place
    ) -> None:
        if not self.chunks or self.chunks[-1] is not place:
            self.chunks.append(place)
        messages = self.channels.setdefault(channel, Messages())
        messages.times.append(time)
        messages.samples.append(sample)
        messages.chunks.append(len(self.chunks) - 1)
        messages.offsets.append(offset)
        messages.lengths.append(length)

    def of(self, topic: str) -> Messages:
        """Messages of a topic; none where the file has no such channel."""
        for channel in self.found.copies:
            if channel.topic == topic and channel.id in self.channels:
                return self.channels[channel.id]
        return Messages()


class Content:
    """The bytes of messages, read when asked; the newest chunks are kept."""

    def __init__(self, index: Index) -> None:
        self._index = index
        self._chunk = lru_cache(KEPT)(self._read)  # several players may read one recording

    def __call__(self, messages: Messages, row: int) -> bytes:
        """Bytes of one message.

        Raises
        ------
        DataFormatError
            The file has changed since it was opened.
        """
        chunk = self._chunk(messages.chunks[row])
        start, length = messages.offsets[row], messages.lengths[row]
        if length == 0:  # its record says it
            length = HEAD_OF_RECORD.unpack_from(chunk, start - CONTENT)[1] - MESSAGE_HEAD.size
        return chunk[start : start + length]

    def _read(self, number: int) -> bytes:
        try:
            with self._index.path.open("rb") as file:
                return read_chunk(file, self._index.chunks[number])
        except (OSError, *DAMAGED) as error:
            raise DataFormatError(f"has changed since: {error}", self._index.path) from None


class McapSamples:
    """Values (t, channels) of a recording, read from its chunks when asked.

    Parameters
    ----------
    index : Index
    kind : {"raw", "pressure"}
    channels : int

    Raises
    ------
    DataFormatError
        A sample of another number of values.
    """

    def __init__(self, index: Index, kind: Kind, channels: int) -> None:
        self._channels, self._path = channels, index.path
        self._content = Content(index)
        self._messages: dict[ros2.Number, Messages] = {
            number: index.of(topic) for (each, number), topic in TOPICS.items() if each == kind
        }
        times, samples, numbers, rows = [], [], [], []
        for place, (number, messages) in enumerate(self._messages.items()):
            self._check_lengths(number, messages)
            times.append(np.array(messages.times, np.uint64))
            samples.append(np.array(messages.samples, np.uint32))
            numbers.append(np.full(len(messages), place, np.uint8))
            rows.append(np.arange(len(messages), dtype=np.uint32))
        stamps = np.concatenate(times)
        order: IntArray | slice = slice(None)
        if (stamps[1:] < stamps[:-1]).any() or sum(map(len, samples)) > max(map(len, samples)):
            # Those of one time in the order in which they were written.
            order = np.lexsort((np.concatenate(samples), stamps))
        self.stamps: IntArray = stamps[order].astype(np.int64)
        self.times: FloatArray = seconds_of(stamps[order])
        self.samples: NDArray[Any] = np.concatenate(samples)[order]
        self._numbers, self._rows = np.concatenate(numbers)[order], np.concatenate(rows)[order]
        floats = len(self._messages["Float32"]) > 0
        self.dtype = ros2.DTYPES["Float32" if floats else "UInt8"]

    def _check_lengths(self, number: ros2.Number, messages: Messages) -> None:
        wanted = ros2.HEAD.size + self._channels * ros2.DTYPES[number].itemsize
        lengths = np.array(messages.lengths, np.int64)
        other = np.flatnonzero((lengths != wanted) & (lengths > 0))
        if len(other):
            size = messages.lengths[int(other[0])] - ros2.HEAD.size
            raise DataFormatError(
                f"sample {other[0]} has {max(size, 0) // ros2.DTYPES[number].itemsize} values, its "
                f"skin {self._channels} channels",
                self._path,
            )

    def __len__(self) -> int:
        return len(self.times)

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        names = tuple(self._messages)
        chosen = list(zip(self._numbers[rows].tolist(), self._rows[rows].tolist(), strict=True))
        values = np.zeros((len(chosen), self._channels), self.dtype)
        for place, (which, row) in enumerate(chosen):
            message = self._content(self._messages[names[which]], row)
            try:
                values[place] = ros2.decode(message, names[which])
            except ValueError as error:
                raise DataFormatError(f"sample {row}: {error}", self._path) from None
        return values


FORMATS = ("skinmap-mcap-1", FORMAT)  # the first had touches and angles as bare JSON
OLD_JOINTS = "/joints"
MAX_JOINTS = 10_000
MAX_CHANNELS = 1_000_000  # a skin of more is damage
REPAIR_SECONDS = 10.0  # nothing is lived through here, so chunks close by size


def read_track(path: Path, *, kind: Kind | None = None) -> RecordedStream:
    """Open a Skinmap recording; a cut or damaged one with all that can be had of it.

    Parameters
    ----------
    path : Path
    kind : {"raw", "pressure"}, optional
        Pressures where they were recorded, else raw values.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, not MCAP, or MCAP of somebody else.
    """
    index = Index(path, trusted=True)
    head = read_head(index.found)
    widths = head_value(head, "widths", dict, path)
    kinds: list[Kind] = [each for each in ("pressure", "raw") if each in widths]
    if kind is None:
        full = {one for (one, _), topic in TOPICS.items() if len(index.of(topic))}
        kind = ([each for each in kinds if each in full] or kinds or ["raw"])[0]
    if kind not in widths:
        raise DataFormatError(f"holds no {kind} values, only {', '.join(kinds)}", path)
    parts = tuple(str(part) for part in head_value(head, "parts", list, path))
    columns = check_widths(widths[kind], parts, path)
    values = McapSamples(index, kind, sum(columns))
    rate, held = head_number(head, "rate", path), head_number(head, "chunk_seconds", path)
    joints, angles = _angles(index, values.stamps)
    prints = head_value(head, "fingerprints", dict, path)
    return RecordedStream(
        StreamInfo(
            head.get("name", "") or path.name,
            parts,
            columns,
            rate_by_times(values.times, rate),
            kind,
            head.get("robot", ""),
            {part: str(word) for part, word in prints.items()},
            head.get("clock", "recording"),
        ),
        values.times,
        values,
        touches=_touches(index, values.stamps, head),
        joints=joints,
        angles=angles,
        tables=_tables(index.found),
        loss=_loss(index.found, values, rate or measured_rate(values.times), held, head),
        samples={
            part: int(count)
            for part, count in head_value(head, "samples", dict, path).items()
            if isinstance(count, int)
        },
        manifest=head.get("manifest", ""),
        overview=Overview.parse(index.found.attachments.get(OVERVIEW, b""), parts),
    )


def _said(message: bytes) -> Any:
    """What a message says: JSON in a text, or bare as in the first format."""
    return json.loads(message if message[:1] == b"{" else read_text(message))


def _objects(
    index: Index, topic: str, read: Callable[[bytes], Any] = _said
) -> list[tuple[int, dict[str, Any]]]:
    """Time [ns] and content of each message of a topic, in the order of time."""
    messages, content = index.of(topic), Content(index)
    found = []
    for row in messages.order().tolist():
        try:
            one = read(content(messages, row))
        except (ValueError, RecursionError):
            one = None
        if not isinstance(one, dict):
            raise DataFormatError(f"message {row} of {topic} is damaged", index.path)
        found.append((messages.times[row], one))
    return found


class _Mark(msgspec.Struct):
    """What a message of `TOUCHES` says."""

    part: str
    event: int
    label: str
    began_s: float
    ended_s: float | None = None
    subject: int = 0
    owners: dict[str, Any] | None = None
    session: str | None = None
    person: str | None = None
    motion: Any = None
    channels: tuple[int, ...] = ()
    answers: dict[str, Any] | None = None  # of files since models answer


def _touches(index: Index, stamps: IntArray, head: dict[str, str]) -> tuple[MarkedTouch, ...]:
    """Touches by what was said at their end, else at their beginning."""
    marks: dict[tuple[str, int, float], _Mark] = {}
    for _, told in _objects(index, TOUCHES):
        try:
            one = msgspec.convert(told, _Mark)
        except msgspec.ValidationError as error:
            raise DataFormatError(f"a touch is damaged: {error}", index.path) from None
        key = (one.part, one.event, one.began_s)
        if key not in marks or one.ended_s is not None:
            marks[key] = one
    return tuple(_touch(one, stamps, head, index.path) for one in marks.values())


def _touch(one: _Mark, stamps: IntArray, head: dict[str, str], path: Path) -> MarkedTouch:
    whose = f"touch {one.event} of {one.part!r}"
    try:
        first = int(np.searchsorted(stamps, nanoseconds_of(one.began_s)))
        last = len(stamps) - 1
        if one.ended_s is not None:
            last = int(np.searchsorted(stamps, nanoseconds_of(one.ended_s), side="right")) - 1
    except InvalidArrayError:
        raise DataFormatError(f"{whose} has no time", path) from None
    try:
        motion = None if one.motion is None else TrueMotion.from_arrays(one.motion)
    except (KeyError, TypeError, ValueError, IndexError):
        raise DataFormatError(f"the motion of {whose} is damaged", path) from None
    session = head.get("session", "") if one.session is None else one.session
    person = head.get("person", "") if one.person is None else one.person
    return MarkedTouch(
        one.part, one.event, one.label, first, last, one.subject, one.owners, session, person,
        motion, one.channels, one.answers,
    )  # fmt: skip


def _angles(index: Index, stamps: IntArray) -> tuple[tuple[str, ...], FloatArray]:
    """Names of the joints and their angles (t, j), each from the last message before a sample."""
    rows = _objects(index, JOINT_STATES, read_joints) or _objects(index, OLD_JOINTS)
    joints = tuple(dict.fromkeys(name for _, one in rows for name in one))
    if len(joints) > MAX_JOINTS:
        raise DataFormatError(f"{len(joints)} joints; no robot has so many", index.path)
    angles = np.full((len(stamps) if joints else 0, len(joints)), np.nan)
    place = {name: column for column, name in enumerate(joints)}
    for time, one in rows:
        row = int(np.searchsorted(stamps, time))
        for name, angle in one.items():
            if isinstance(angle, int | float):
                angles[row : row + 1, place[name]] = angle
    known = np.where(np.isnan(angles), 0, np.arange(1, len(angles) + 1)[:, None])
    latest = np.maximum.accumulate(known, axis=0) if len(angles) else known
    return joints, np.where(
        latest > 0, np.take_along_axis(angles, (latest - 1).clip(0), axis=0), np.nan
    )


def _tables(found: Scan) -> dict[str, TaxelTable]:
    """The skins in the file; a damaged one is left out, the samples do not need it."""
    tables = {}
    for name, data in found.attachments.items():
        if name.startswith(TABLES) and name.endswith(".csv"):
            part = name.removeprefix(TABLES).removesuffix(".csv")
            try:
                tables[part] = parse_csv(data.decode(), found.path)
            except (SkinError, UnicodeDecodeError) as error:
                found.damage.append(f"the table of {part!r}: {error}")
    return tables


def _loss(found: Scan, values: McapSamples, rate: float, held: float, head: dict[str, str]) -> Loss:
    """What is missing now, and what a repaired file remembers of the one it was made from."""
    before = Loss()
    if REPAIRED in head:
        before = Loss(True, head_number(head, REPAIRED, found.path), ("repaired before",))
    if found.finished and not found.damage:
        return before
    step = 1.0 / rate if rate > 0 else 0.0
    times, samples = values.times, values.samples.astype(np.int64)
    missing = np.diff(samples) > 1
    seconds = float((np.diff(times)[missing] - step).clip(0.0).sum())
    seconds += step * float(samples[0] if len(samples) else 0)
    last = times[-1] if len(times) else 0.0
    promised = found.promised / NS - last
    if promised > 0 and len(times):
        seconds += float(promised)
    elif not found.finished:
        seconds += held
    # The samples missing inside are in both.
    return Loss(True, max(seconds, before.seconds), tuple(found.damage[:100]))


def read_head(found: Scan) -> dict[str, str]:
    """What the file says of itself, from wherever it survived."""
    tables = [*found.metadata.values(), *(channel.metadata for channel in found.copies)]
    copies = [table for table in tables if table.get("format") in FORMATS]
    if not copies:
        why = f" ({found.damage[0]})" if found.damage else ""
        raise DataFormatError(
            f"not a Skinmap recording: it names no skin{why}; a foreign bag needs a "
            f"mapping file {found.path.stem}.map.toml beside it (docs/tools.md)",
            found.path,
        )
    return _agreed(copies, found)


def _agreed(copies: list[dict[str, str]], found: Scan) -> dict[str, str]:
    """What most copies say: these records carry no checksum, but they repeat each other."""
    agreed = {}
    for key in sorted({key for copy in copies for key in copy} - {ros2.QOS_KEY}):
        said = Counter(copy.get(key) for copy in copies)
        ((value, _),) = said.most_common(1)
        if len(said) > 1:
            found.damage.append(f"its copies of {key!r:.40} differ")
        if value is not None:
            agreed[key] = value
    return agreed


def head_value(head: dict[str, str], key: str, kind: type[Any], path: Path) -> Any:
    """A value that stands in the head as JSON; DataFormatError if it is no such."""
    try:
        value = json.loads(head.get(key, "null"))
    except (ValueError, RecursionError):
        value = None
    if not isinstance(value, kind):
        raise DataFormatError(f"its {key} are damaged", path)
    return value


def head_number(head: dict[str, str], key: str, path: Path) -> float:
    """A number of the head, not negative; 0 where it is not there."""
    try:
        number = float(head.get(key, "0"))
    except ValueError:
        number = float("nan")
    if not 0 <= number < np.inf:
        raise DataFormatError(f"its {key} is damaged", path)
    return number


def check_widths(widths: Any, parts: tuple[str, ...], path: Path) -> tuple[int, ...]:
    """Columns of each part, if that can be."""
    whole = isinstance(widths, list) and all(type(width) is int for width in widths)
    if not whole or len(widths) != len(parts) or not parts or len(set(parts)) != len(parts):
        raise DataFormatError(f"{len(parts)} parts with widths {widths!r:.60}", path)
    if min(widths) < 1 or sum(widths) > MAX_CHANNELS:
        raise DataFormatError(f"a skin of {sum(widths)} channels", path)
    return tuple(widths)


def write_repaired(path: Path, output: Path) -> RecordedStream:
    """Copy all messages that can be had, the skin and the touches into a whole file.

    Parameters
    ----------
    path : Path
        A recording of ours.
    output : Path
        MCAP with an index; it remembers what the damaged file had lost.

    Returns
    -------
    RecordedStream
        What is in it.

    Raises
    ------
    MissingFileError, DataFormatError
        As for `read_track`.
    OutputError
        The output cannot be written.
    """
    track = read_track(path)  # refuses what is no recording of ours, or one that makes no sense
    index = Index(path)
    head = read_head(index.found)
    if track.loss.recovered:
        head[REPAIRED] = repr(track.loss.seconds)
    with _copied(index, head, output) as (writer, numbers):
        _copy(writer, index, numbers)
        words = {ros2.BAG_METADATA: {ros2.BAG_KEY: ros2.bag_metadata(output.name, _facts(index))}}
        writer.finish(words, overview_of(track, track.touches))
    return track


def write_marked(path: Path, output: Path, touches: Sequence[MarkedTouch]) -> None:
    """Copy a recording with other touches marked in it; everything else stays.

    Raises
    ------
    MissingFileError, DataFormatError
        As for `read_track`.
    OutputError
        The output cannot be written.
    """
    track = read_track(path)
    index = Index(path)
    head = read_head(index.found)
    channels = index.found.channels
    old = next((number for number, one in channels.items() if one.topic == TOUCHES), None)
    if old is None:
        raise DataFormatError("has no channel for touches", path)
    bare = channels[old].message_encoding != "cdr"  # as in the first format
    with _copied(index, head, output) as (writer, numbers):
        place = numbers[old]
        _copy(writer, index, {each: new for each, new in numbers.items() if new != place})
        for one in touches:
            began, ended = track.times[[one.first, one.last]].tolist()
            stamp, text = mark_text(one, began, ended, head)
            writer.add_message(place, stamp, text.encode() if bare else text_message(text), 0)
        writer.finish(overview=overview_of(track, touches))


@contextmanager
def _copied(
    index: Index, head: dict[str, str], output: Path
) -> Iterator[tuple[McapWriter, dict[int, int]]]:
    """A new file with the head, channels and tables of another, and the new numbers by the old."""
    with refused(repr(str(output))), output.open("wb", buffering=0) as file:
        writer = McapWriter(file, chunk_seconds=REPAIR_SECONDS)
        writer.add_metadata(METADATA, head)
        numbers = _channels(writer, index, head)
        for name, data in sorted(index.found.attachments.items()):
            if name not in (OVERVIEW, WHOLE):  # of the other file
                writer.add_attachment(name, "text/csv", data)
        yield writer, numbers


def _channels(writer: McapWriter, index: Index, head: dict[str, str]) -> dict[int, int]:
    """Describe the channels anew; their new numbers by the old ones."""
    found = index.found
    schemas = {
        number: writer.add_schema(one.name, one.encoding, one.data)
        for number, one in sorted(found.schemas.items())
    }
    numbers: dict[int, int] = {}
    ours = {*TOPICS.values(), TOUCHES, JOINT_STATES, OLD_JOINTS}
    # A channel is described twice: where one copy is damaged, the other one names its topic.
    named = found.channels | {one.id: one for one in found.copies if one.topic in ours}
    for number, one in sorted(named.items()):
        own = {**one.metadata, **(head if "format" in one.metadata else {})}
        schema = schemas.get(one.schema_id, 0)
        numbers[number] = writer.add_channel(one.topic, one.message_encoding, schema, own)
    return numbers


def _facts(index: Index) -> dict[str, ros2.TopicFacts]:
    """Topics of the messages that were found."""
    found, facts = index.found, dict[str, ros2.TopicFacts]()
    for number, one in sorted(found.channels.items()):
        kind = found.schemas[one.schema_id].name if one.schema_id in found.schemas else ""
        topic = facts[one.topic] = ros2.TopicFacts(kind, latched=one.topic in LATCHED)
        for stamp in index.channels.get(number, Messages()).times:
            topic.count(stamp)
    return facts


def _copy(writer: McapWriter, index: Index, numbers: dict[int, int]) -> None:
    """All messages of known channels, in the order in which they stood in the file."""
    content = Content(index)
    places = (
        zip(messages.chunks, messages.offsets, repeat(number), count(), strict=False)
        for number, messages in index.channels.items()
        if number in numbers
    )
    for _, _, number, row in merge(*places):
        messages = index.channels[number]
        data = content(messages, row)
        writer.add_message(numbers[number], messages.times[row], data, messages.samples[row])
