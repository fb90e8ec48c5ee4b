"""Writing recordings in MCAP so that whatever ends the process leaves a file that opens.

The writer is that of the package `mcap`. Here it is told to close a chunk by age as well as by
size; a chunk reaches the system in one write, and a write that fails is taken back. Our layout of
the file is described in docs/recordings.md, the format at https://mcap.dev/spec.
"""

from __future__ import annotations

import io
import json
import os
import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from skinmap import __version__
from skinmap.errors import OutputError, SkinMismatchError, check_known
from skinmap.io.mcap.mcap_scan import MAGIC, WHOLE
from skinmap.io.recordings.recorded_stream import (
    NS,
    OVERVIEW,
    Kind,
    MarkedTouch,
    OverviewMaker,
    RecordedStream,
    StreamInfo,
    nanoseconds_of,
    whole_counts,
)
from skinmap.io.ros2 import messages as ros2
from skinmap.io.ros2.messages import TouchMarker, joints_message, text_message
from skinmap.io.ros2.robot_topics import JOINT_STATES, LATCHED, TYPES, RobotTopics, RobotView
from skinmap.io.taxels.taxel_table import csv_text
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin, fingerprint
from skinmap.skin.taxels import TaxelTable

CHUNK_BYTES = 64 * 1024
CHUNK_SECONDS = 0.1  # half of what may be lost; the other half is for a busy machine
KEPT = 4  # of the newest writes whose places are known: a file ends where one of them began


class McapWriter:
    """Records of an MCAP file, in chunks that close by size or by age.

    Parameters
    ----------
    file : binary file
        Unbuffered (`open(path, "wb", buffering=0)`), at its beginning.
    chunk_bytes : int
        Uncompressed size that closes a chunk.
    chunk_seconds : float
        Age that closes a chunk, in messages' time and by the clock.

    Notes
    -----
    An `OSError` (no space left) is passed on after the half-written record was taken back; then
    only `finish` may follow. It ends the file in fifty bytes, at the cost of its last chunk where
    even these do not fit.
    """

    def __init__(
        self,
        file: IO[bytes],
        *,
        chunk_bytes: int = CHUNK_BYTES,
        chunk_seconds: float = CHUNK_SECONDS,
    ) -> None:
        from mcap.writer import Writer

        self._sink, self._age = _WholeWrites(file), chunk_seconds
        self._writer: Any = Writer(self._sink, chunk_size=chunk_bytes)  # type: ignore[arg-type]
        self._span: tuple[int, int] | None = None  # of the open chunk's messages [ns]
        self._began = 0.0
        self._writer.start(profile="ros2", library=f"skinmap {__version__}")
        self._sink.flush()

    @property
    def size(self) -> int:
        """Bytes that the system has."""
        return self._sink.size

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Describe a kind of message; its number."""
        from mcap.records import Schema

        number = int(self._writer.register_schema(name, encoding, data))
        self._say(Schema(number, data, encoding, name))
        return number

    def add_channel(
        self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str] | None = None
    ) -> int:
        """Open a channel for messages of one kind; its number."""
        from mcap.records import Channel

        known = dict(metadata or {})
        number = int(self._writer.register_channel(topic, encoding, schema, known))
        self._say(Channel(number, topic, encoding, known, schema))
        return number

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write a table of words."""
        self._writer.add_metadata(name, dict(content))
        self._sink.flush()

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Write a small file into this one."""
        self._writer.add_attachment(0, 0, name, media_type, data)
        self._sink.flush()

    def add_message(self, channel: int, nanoseconds: int, data: bytes, sequence: int) -> None:
        """Add a message to the open chunk; close the chunk if it is large or old enough."""
        if self._span is None:
            self._began, self._span = time.monotonic(), (nanoseconds, nanoseconds)
        low, high = min(self._span[0], nanoseconds), max(self._span[1], nanoseconds)
        self._span = (low, high)
        self._writer.add_message(channel, nanoseconds, data, nanoseconds, sequence & 0xFFFFFFFF)
        if self._sink.waiting or max(self.age, (high - low) / NS) >= self._age:
            self.flush()

    @property
    def age(self) -> float:
        """Seconds since the first message that is not yet in a closed chunk; 0 where none is."""
        return 0.0 if self._span is None else time.monotonic() - self._began

    def flush(self) -> None:
        """Close the open chunk and give it to the system."""
        self._span = None
        self._writer.flush()

    @property
    def broken(self) -> bool:
        """Whether the system refused a write: only `finish` may follow."""
        return self._sink.broken

    def finish(
        self,
        metadata: Mapping[str, Mapping[str, str]] | None = None,
        overview: bytes | None = None,
    ) -> None:
        """End the file, with last tables, its overview and index where there is room for them."""
        if not self.broken:
            try:
                self.flush()
                for name, content in (metadata or {}).items():
                    self._writer.add_metadata(name, dict(content))
                if overview is not None:
                    self.add_attachment(OVERVIEW, "text/csv", overview)
                    whole = {"bytes": self._sink.size, "crc32": self._sink.checksum}
                    self.add_attachment(WHOLE, "application/json", json.dumps(whole).encode())
                self._writer.finish()
                self._sink.flush()
                return
            except OSError:
                self._end_shortly()
                raise
        self._end_shortly()

    def _say(self, record: Any) -> None:
        """Write a description at once; the writer's own stands in a chunk, which may be lost."""
        from mcap.data_stream import RecordBuilder

        builder = RecordBuilder()
        record.write(builder)
        self._sink.write(builder.end())
        self._sink.flush()

    def _end_shortly(self) -> None:
        """End without an index: readers then go through the file from its beginning."""
        from mcap.data_stream import RecordBuilder
        from mcap.records import DataEnd, Footer

        builder = RecordBuilder()
        DataEnd(0).write(builder)
        Footer(0, 0, 0).write(builder)  # no checksum is asked for
        end = builder.end() + MAGIC
        while True:
            self._sink.write(end)
            try:
                self._sink.flush()
                return
            except OSError:
                if not self._sink.step_back():
                    return  # not even a header fits: nothing was recorded


class _WholeWrites:
    """A file for `mcap.writer.Writer` that gets all that came between two flushes, or nothing."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.waiting = bytearray()
        self._starts: list[int] = []
        self.size = self.checksum = 0
        self.broken = False

    def write(self, data: bytes) -> int:
        self.waiting += data
        return len(data)

    def tell(self) -> int:
        return self.size + len(self.waiting)

    def flush(self) -> None:
        rest = memoryview(bytes(self.waiting))
        self.waiting.clear()
        length, checksum = len(rest), zlib.crc32(rest, self.checksum)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError:
            self.broken = True
            self._cut(self.size)
            raise
        self._starts = [*self._starts[1 - KEPT :], self.size]
        self.size += length
        self.checksum = checksum

    def step_back(self) -> bool:
        """Take the newest write back; False where its place is not known."""
        if not self._starts:
            return False
        self._cut(self._starts.pop())
        return True

    def _cut(self, size: int) -> None:
        self.size = size
        self._file.truncate(size)
        self._file.seek(size)


FORMAT = "skinmap-mcap-2"
METADATA = "skinmap"
REPAIRED = "repaired_lost_seconds"  # in the head of a file that was made from a damaged one
TOUCHES = "/skin/touches"  # texts of JSON: docs/recordings.md
POINTS_HZ = 0.5  # clouds of all taxels: 16 bytes a taxel, which hardly compress
TOPICS: dict[tuple[Kind, ros2.Number], str] = {
    ("raw", "UInt8"): "/skin/raw",
    ("raw", "Float32"): "/skin/raw_float",
    ("pressure", "UInt8"): "/skin/pressure",
    ("pressure", "Float32"): "/skin/pressure_float",
}
TABLES = "skin/"  # attachments: skin/<part>.csv
# What the head has of a recording in a word each.
WORDS = dict.fromkeys(("name", "robot", "manifest", "session", "person", "continues"), "")
WORDS["clock"] = "recording"


class McapRecording:
    """One recording file that is being written.

    Parameters
    ----------
    path : Path
    parts : sequence of str
        Whose values follow each other in a sample.
    widths : mapping of kind to sequence of int
        Columns of each part, for each kind of values that will be written.
    rate : float
        Nominal samples a second; 0 where they come when they like.
    fingerprints : mapping of str to str
        Of the skins, where no skin is given.
    skins : mapping of str to Skin
        Written into the file, so that it explains itself.
    samples : mapping of str to int
        How many of the first samples each part really has, where parts differ.
    chunk_seconds : float
        Most that a killed process may lose.
    model : Robot, optional
        What ROS 2's tools draw: its description, transforms, and clouds of its taxels are written.
    points_hz : float
        Clouds a second at most; `inf` one with every sample, 0 none.
    **words : str
        `WORDS` of the head: `name`, `robot`, `manifest` and `clock`, `session` and `person` of all
        touches that do not say otherwise, and `continues`, the file that this one goes on from.

    Raises
    ------
    OutputError
        The file cannot be made or written to.
    """

    def __init__(
        self,
        path: Path,
        *,
        parts: Sequence[str],
        widths: Mapping[Kind, Sequence[int]],
        rate: float = 0.0,
        fingerprints: Mapping[str, str] | None = None,
        skins: Mapping[str, Skin] | None = None,
        samples: Mapping[str, int] | None = None,
        chunk_seconds: float = CHUNK_SECONDS,
        model: Robot | None = None,
        points_hz: float = POINTS_HZ,
        **words: str,
    ) -> None:
        check_known("word of a recording", words, WORDS)
        self.path = path
        self.samples: dict[Kind, int] = dict.fromkeys(widths, 0)
        self._widths = {kind: tuple(each) for kind, each in widths.items()}
        self._parts = tuple(parts)
        self._ids: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._facts: dict[str, ros2.TopicFacts] = {}
        self._view: RobotView | None = None
        known = dict(fingerprints or {})
        known |= {part: fingerprint(skin) for part, skin in (skins or {}).items()}
        head = {
            "format": FORMAT,
            "rate": repr(float(rate)),
            "began": datetime.now(UTC).isoformat(timespec="seconds"),
            "chunk_seconds": repr(chunk_seconds),
            "parts": json.dumps(list(parts)),
            "widths": json.dumps(self._widths),
            "fingerprints": json.dumps(known),
            "samples": json.dumps(dict(samples or {})),
            **WORDS,
            **words,
        }
        self._head = head
        try:
            self._file = _alone(path)
        except BlockingIOError:
            raise OutputError(f"cannot write {str(path)!r}: another recorder writes it") from None
        except OSError as error:
            raise OutputError(f"cannot write {str(path)!r}: {error.strerror}") from None
        with self._disk():
            self._writer = McapWriter(self._file, chunk_seconds=chunk_seconds)
            self._writer.add_metadata(METADATA, head)
            self._open_channels(model is not None)
            for part, skin in (skins or {}).items():
                self._writer.add_attachment(f"{TABLES}{part}.csv", "text/csv", table_of(skin))
        self._shown: Kind = "pressure" if "pressure" in widths else "raw"
        self._overview = OverviewMaker(self._widths[self._shown], self._shown == "raw")
        if model is not None:
            topics = RobotTopics(model, self._parts, self._widths[self._shown], self._shown)
            self._view = RobotView(topics, self._message, points_hz)

    def _open_channels(self, shows_robot: bool) -> None:
        # The head stands in the channels too: a damaged page at the beginning cannot take it all.
        for (kind, number), topic in TOPICS.items():
            if kind in self._widths:
                self._open(topic, ros2.array_type(number), self._head)
        self._open(TOUCHES, "std_msgs/String", {})
        for topic, type_name in TYPES.items():
            if shows_robot or topic == JOINT_STATES:
                self._open(topic, type_name, {})

    def _open(self, topic: str, kind: str, words: Mapping[str, str]) -> None:
        if kind not in self._schemas:
            text = ros2.definition(kind)
            self._schemas[kind] = self._writer.add_schema(ros2.full_name(kind), "ros2msg", text)
        qos = {ros2.QOS_KEY: ros2.qos_profile(latched=topic in LATCHED)}
        self._facts[topic] = ros2.TopicFacts(ros2.full_name(kind), latched=topic in LATCHED)
        number = self._schemas[kind]
        self._ids[topic] = self._writer.add_channel(topic, "cdr", number, {**words, **qos})

    @property
    def size(self) -> int:
        """Bytes written."""
        return self._writer.size

    def add(self, kind: Kind, time: float, values: NDArray[Any]) -> None:
        """Write one sample.

        Parameters
        ----------
        kind : {"raw", "pressure"}
        time : float
            In the source's clock [s].
        values : (channels,) array
            Whole counts of 0 to 255 take a byte, other numbers four.

        Raises
        ------
        SkinMismatchError
            Another number of channels.
        InvalidArrayError
            A time that is none.
        OutputError
            No room; the written part stays readable.
        """
        channels = sum(self._widths[kind])
        if np.shape(values) != (channels,):
            raise SkinMismatchError(
                f"{self.path.name}: {kind} values of shape {np.shape(values)}, the skin has "
                f"{channels} channels"
            )
        number: ros2.Number = "UInt8" if whole_counts(values) else "Float32"
        message, stamp = ros2.encode(values, number), nanoseconds_of(time)
        self._message(TOPICS[kind, number], stamp, message, self.samples[kind])
        self.samples[kind] += 1
        if kind == self._shown:
            self._overview.add(time, values)
        if self._view is not None and kind == self._shown:
            self._view.sample(stamp, values)

    def add_angles(self, time: float, angles: Mapping[str, float]) -> None:
        """Write joint angles [rad] that belong to the sample of a time [s]."""
        stamp = nanoseconds_of(time)
        self._message(JOINT_STATES, stamp, joints_message(stamp, angles), 0)
        if self._view is not None:
            self._view.angles(stamp, angles)

    def show_touches(self, time: float, touches: Sequence[TouchMarker]) -> None:
        """Write markers of what touches at a time [s]; those of before that ended are taken away.

        Where the file shows no robot, nothing is written.
        """
        if self._view is not None:
            self._view.touches(nanoseconds_of(time), touches)

    def mark(
        self,
        part: str,
        event: int,
        label: str,
        *,
        began: float,
        ended: float | None = None,
        **known: Any,
    ) -> None:
        """Mark a touch; what is said at its end counts more than what was said before.

        Parameters
        ----------
        part : str
        event : int
            The same number from its beginning to its end.
        label : str
        began, ended : float
            Times of its first and, once it has ended, its last sample [s].
        **known
            What else `MarkedTouch` has: `subject`, `owners`, `session` and `person` where they are
            not those of the file, `motion`, `channels`, `answers`.
        """
        one = MarkedTouch(part, event, label, 0, 0, **known)
        self._mark(one, began, mark_text(one, began, ended, {}))

    def add_all(self, track: RecordedStream) -> None:
        """Write a whole recording, each touch once its last sample is there, and close the file."""
        marks = [touch for touch in track.touches if touch.first <= touch.last]
        marks.sort(key=lambda touch: touch.last, reverse=True)
        try:
            for row, time in enumerate(track.times.tolist()):
                if track.joints:
                    angles = zip(track.joints, track.angles[row].tolist(), strict=True)
                    self.add_angles(time, {name: a for name, a in angles if np.isfinite(a)})
                self.add(track.kind, time, track.values[row : row + 1][0])
                while marks and marks[-1].last == row:
                    one = marks.pop()
                    began, ended = track.times[[one.first, one.last]].tolist()
                    self._mark(one, began, mark_text(one, began, ended, self._head))
        finally:
            self.close()

    def _mark(self, one: MarkedTouch, began: float, mark: tuple[int, str]) -> None:
        stamp, text = mark
        self._overview.mark(self._parts.index(one.part), one.event, began)
        self._message(TOUCHES, stamp, text_message(text), 0)

    def flush(self) -> None:
        """Give everything to the system."""
        with self._disk():
            self._writer.flush()

    @property
    def age(self) -> float:
        """Seconds that something has waited to be given to the system."""
        return self._writer.age

    def close(self) -> None:
        """End the file; may be called twice.

        Raises
        ------
        OutputError
            No room for the end; the written part stays readable.
        """
        if self._file.closed:
            return
        with self._file:
            try:
                if self._view is not None and not self._writer.broken:
                    self._view.end()
            finally:
                with self._disk():
                    words = {ros2.BAG_METADATA: {ros2.BAG_KEY: self.bag_metadata()}}
                    made = self._overview.overview().to_bytes(self._parts)
                    self._writer.finish(words, made if self._overview.even else None)

    def bag_metadata(self) -> str:
        """What rosbag2 keeps of a bag beside its messages, as YAML."""
        return ros2.bag_metadata(self.path.name, self._facts)

    def _message(self, topic: str, stamp: int, content: bytes, sample: int) -> None:
        self._facts[topic].count(stamp)
        with self._disk():
            self._writer.add_message(self._ids[topic], stamp, content, sample)

    @contextmanager
    def _disk(self) -> Iterator[None]:
        """Says which file the system refused to write, and why."""
        try:
            yield
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(
                f"cannot go on writing {str(self.path)!r}: {error.strerror}; the written "
                f"part stays readable"
            ) from None


def said_of(info: StreamInfo, robot: Robot | None) -> dict[str, Any]:
    """What a `McapRecording` takes of a stream, and of the robot whose skin it is, if known."""
    found = {name: getattr(info, name) for name in ("parts", "rate", "name", "robot", "clock")}
    found["fingerprints"] = info.fingerprints
    if robot is not None:
        found["robot"], found["manifest"] = info.robot or robot.name, robot.origin
        found["skins"] = {part: robot.skin(part) for part in info.parts}
    return found


def mark_text(
    one: MarkedTouch, began: float, ended: float | None, head: Mapping[str, str]
) -> tuple[int, str]:
    """Time stamp [ns] and content of the mark of a touch; what the head says holds for all."""
    content: dict[str, Any] = {
        "part": one.part,
        "event": one.event,
        "label": one.label,
        "began_s": began,
        "subject": one.subject,
    }
    if ended is not None:
        content["ended_s"] = ended
    said = {"session": one.session, "person": one.person}
    content |= {key: word for key, word in said.items() if word != head.get(key, "")}
    if one.owners:
        content["owners"] = dict(one.owners)
    if one.channels:
        content["channels"] = list(one.channels)
    if one.motion is not None:
        content["motion"] = {key: rows.tolist() for key, rows in one.motion.to_arrays().items()}
    if one.answers is not None:
        content["answers"] = dict(one.answers)
    stamp = nanoseconds_of(began if ended is None else ended)
    return stamp, json.dumps(content, separators=(",", ":"))


def table_of(skin: Skin) -> bytes:
    """The taxels of a skin as our CSV."""
    table = TaxelTable(skin.channels, skin.modules, skin.positions, skin.normals, link=skin.link)
    return csv_text(table).encode()


def _alone(path: Path) -> io.FileIO:
    """A new file for this recorder alone; one that another recorder writes is left as it is.

    Raises
    ------
    BlockingIOError, OSError
        Another recorder writes it; the system refuses.
    """
    import fcntl

    file = io.FileIO(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666), "r+")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        file.truncate(0)
    except BaseException:
        file.close()
        raise
    return file
