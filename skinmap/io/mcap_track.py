"""Reading our recordings in MCAP, also those that were cut off or damaged."""

from __future__ import annotations

import json
from array import array
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, InvalidArrayError, SkinError
from skinmap.io.cdr import DTYPES, HEAD, Number, decode
from skinmap.io.mcap_recording import FORMAT, JOINTS, METADATA, TABLES, TOPICS, TOUCHES
from skinmap.io.mcap_scan import DAMAGED, Place, Scan, read_chunk, scan
from skinmap.io.table import parse_csv
from skinmap.io.track import (
    NS,
    Kind,
    Loss,
    MarkedTouch,
    Track,
    measured_rate,
    nanoseconds_of,
    seconds_of,
)
from skinmap.skin.taxels import TaxelTable

KEPT = 4  # chunks kept unfolded: who plays a recording comes by each of them once
MOST_CHANNELS = 1_000_000  # a skin of more is damage
MOST_JOINTS = 10_000


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
    """All messages of a file by channel, and its chunks."""

    def __init__(self, path: Path) -> None:
        self.channels: dict[int, Messages] = {}
        self.chunks: list[Place] = []
        self.path = path
        self.found = scan(path, self._take)

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
        for number, channel in self.found.channels.items():
            if channel.topic == topic and number in self.channels:
                return self.channels[number]
        return Messages()


class Content:
    """The bytes of messages, read when asked; the newest chunks are kept."""

    def __init__(self, index: Index) -> None:
        self._index = index
        self._kept: OrderedDict[int, bytes] = OrderedDict()

    def __call__(self, messages: Messages, row: int) -> bytes:
        """Bytes of one message.

        Raises
        ------
        DataFormatError
            The file has changed since it was opened.
        """
        number = messages.chunks[row]
        if number not in self._kept:
            try:
                with self._index.path.open("rb") as file:
                    chunk = read_chunk(file, self._index.chunks[number])
            except (OSError, *DAMAGED) as error:
                raise DataFormatError(f"has changed since: {error}", self._index.path) from None
            while len(self._kept) >= KEPT:
                self._kept.popitem(last=False)
            self._kept[number] = chunk
        start = messages.offsets[row]
        return self._kept[number][start : start + messages.lengths[row]]


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
        self._messages: dict[Number, Messages] = {
            number: index.of(topic) for (each, number), topic in TOPICS.items() if each == kind
        }
        times, samples, numbers, rows = [], [], [], []
        for place, (number, messages) in enumerate(self._messages.items()):
            self._check_lengths(number, messages)
            times.append(np.array(messages.times, np.uint64))
            samples.append(np.array(messages.samples, np.int64))
            numbers.append(np.full(len(messages), place))
            rows.append(np.arange(len(messages)))
        stamps = np.concatenate(times)
        # Those of one time in the order in which they were written.
        order = np.lexsort((np.concatenate(samples), stamps))
        self.stamps: IntArray = stamps[order].astype(np.int64)
        self.times: FloatArray = seconds_of(stamps[order])
        self.samples: IntArray = np.concatenate(samples)[order]
        self._numbers, self._rows = np.concatenate(numbers)[order], np.concatenate(rows)[order]
        floats = len(self._messages["Float32"]) > 0
        self.dtype = DTYPES["Float32" if floats else "UInt8"]

    def _check_lengths(self, number: Number, messages: Messages) -> None:
        wanted = HEAD.size + self._channels * DTYPES[number].itemsize
        other = np.flatnonzero(np.array(messages.lengths, np.int64) != wanted)
        if len(other):
            size = messages.lengths[int(other[0])] - HEAD.size
            raise DataFormatError(
                f"sample {other[0]} has {max(size, 0) // DTYPES[number].itemsize} values, its skin "
                f"{self._channels} channels",
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
                values[place] = decode(message, names[which])
            except ValueError as error:
                raise DataFormatError(f"sample {row}: {error}", self._path) from None
        return values


def read_track(path: Path, *, kind: Kind | None = None) -> Track:
    """Open a recording of ours; a cut or damaged one with all that can be had of it.

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
    index = Index(path)
    head = _head(index.found)
    widths = _head_value(head, "widths", dict, path)
    kinds: list[Kind] = [each for each in ("pressure", "raw") if each in widths]
    if kind is None:
        filled = [each for each in kinds if _filled(index, each)]
        kind = (filled or kinds or ["raw"])[0]
    if kind not in widths:
        raise DataFormatError(f"holds no {kind} values, only {', '.join(kinds)}", path)
    parts = tuple(str(part) for part in _head_value(head, "parts", list, path))
    columns = _widths(widths[kind], parts, path)
    values = McapSamples(index, kind, sum(columns))
    rate, held = _number(head, "rate", path), _number(head, "chunk_seconds", path)
    joints, angles = _angles(index, values.stamps)
    return Track(
        head.get("name", "") or path.name,
        kind,
        parts,
        columns,
        values.times,
        values,
        rate=rate,
        robot=head.get("robot", ""),
        fingerprints=_words(head, "fingerprints", path),
        clock=head.get("clock", "recording"),
        touches=_touches(index, values.stamps),
        joints=joints,
        angles=angles,
        tables=_tables(index.found),
        loss=_loss(index.found, values, rate or measured_rate(values.times), held),
        samples={
            part: int(count)
            for part, count in _head_value(head, "samples", dict, path).items()
            if isinstance(count, int)
        },
    )


def _head(found: Scan) -> dict[str, str]:
    """What the file says of itself, from wherever it survived."""
    if found.metadata.get(METADATA, {}).get("format") == FORMAT:
        return found.metadata[METADATA]
    for channel in found.channels.values():
        if channel.metadata.get("format") == FORMAT:
            return dict(channel.metadata)
    why = f" ({found.damage[0]})" if found.damage else ""
    raise DataFormatError(f"no recording of ours: it names no skin{why}", found.path)


def _head_value(head: dict[str, str], key: str, kind: type[Any], path: Path) -> Any:
    try:
        value = json.loads(head.get(key, "null"))
    except (ValueError, RecursionError):
        value = None
    if not isinstance(value, kind):
        raise DataFormatError(f"its {key} are damaged", path)
    return value


def _words(head: dict[str, str], key: str, path: Path) -> dict[str, str]:
    return {str(name): str(word) for name, word in _head_value(head, key, dict, path).items()}


def _number(head: dict[str, str], key: str, path: Path) -> float:
    try:
        number = float(head.get(key, "0"))
    except ValueError:
        number = float("nan")
    if not 0 <= number < np.inf:
        raise DataFormatError(f"its {key} is damaged", path)
    return number


def _widths(widths: Any, parts: tuple[str, ...], path: Path) -> tuple[int, ...]:
    whole = isinstance(widths, list) and all(type(width) is int for width in widths)
    if not whole or len(widths) != len(parts) or not parts or len(set(parts)) != len(parts):
        raise DataFormatError(f"{len(parts)} parts with widths {widths!r:.60}", path)
    if min(widths) < 1 or sum(widths) > MOST_CHANNELS:
        raise DataFormatError(f"a skin of {sum(widths)} channels", path)
    return tuple(widths)


def _filled(index: Index, kind: Kind) -> bool:
    return any(len(index.of(topic)) for (each, _), topic in TOPICS.items() if each == kind)


def _objects(index: Index, topic: str) -> list[tuple[int, dict[str, Any]]]:
    """Time [ns] and content of each JSON message of a topic, in the order of time."""
    messages, content = index.of(topic), Content(index)
    found = []
    for row in messages.order().tolist():
        try:
            one = json.loads(content(messages, row))
        except (ValueError, RecursionError):
            one = None
        if not isinstance(one, dict):
            raise DataFormatError(f"message {row} of {topic} is damaged", index.path)
        found.append((messages.times[row], one))
    return found


def _touches(index: Index, stamps: IntArray) -> tuple[MarkedTouch, ...]:
    """Touches by what was said at their end, else at their beginning."""
    ends: dict[tuple[str, int, float], dict[str, Any]] = {}
    for _, one in _objects(index, TOUCHES):
        kinds: dict[str, Any] = {"part": str, "event": int, "began_s": int | float, "label": str}
        if not all(isinstance(one.get(key), kind) for key, kind in kinds.items()):
            raise DataFormatError("a touch without its part, event, time or label", index.path)
        key = (one["part"], one["event"], one["began_s"])
        if key not in ends or "ended_s" in one:
            ends[key] = one
    touches = []
    for (part, event, began), one in ends.items():
        subject, owners = one.get("subject", 0), one.get("owners")
        try:
            first = int(np.searchsorted(stamps, nanoseconds_of(began)))
            last = len(stamps) - 1
            if "ended_s" in one:
                ended = nanoseconds_of(one["ended_s"])
                last = int(np.searchsorted(stamps, ended, side="right")) - 1
        except (InvalidArrayError, TypeError):
            raise DataFormatError(f"touch {event} of {part!r} has no time", index.path) from None
        if not isinstance(subject, int) or not isinstance(owners, dict | None):
            raise DataFormatError(f"touch {event} of {part!r} is damaged", index.path)
        touches.append(MarkedTouch(part, event, one["label"], first, last, subject, owners))
    return tuple(touches)


def _angles(index: Index, stamps: IntArray) -> tuple[tuple[str, ...], FloatArray]:
    """Names of the joints and their angles (t, j), each from the last message before a sample."""
    rows = _objects(index, JOINTS)
    joints = tuple(dict.fromkeys(name for _, one in rows for name in one))
    if len(joints) > MOST_JOINTS:
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


def _loss(found: Scan, values: McapSamples, rate: float, held: float) -> Loss:
    if found.finished and not found.damage:
        return Loss()
    step = 1.0 / rate if rate > 0 else 0.0
    times, samples = values.times, values.samples
    missing = np.diff(samples) > 1
    seconds = float((np.diff(times)[missing] - step).clip(0.0).sum())
    seconds += step * float(samples[0] if len(samples) else 0)
    last = times[-1] if len(times) else 0.0
    promised = found.promised / NS - last
    if promised > 0 and len(times):
        seconds += float(promised)
    elif not found.finished:
        seconds += held
    return Loss(True, seconds, tuple(found.damage[:100]))
