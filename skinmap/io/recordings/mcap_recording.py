"""Our recordings in MCAP: which channels there are, and writing them.

The layout of the file is described in docs/recordings.md.
"""

from __future__ import annotations

import io
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.errors import OutputError, SkinMismatchError
from skinmap.io.recordings.mcap_writer import CHUNK_SECONDS, McapWriter
from skinmap.io.recordings.recorded_stream import Kind, nanoseconds_of
from skinmap.io.recordings.robot_view import RobotView
from skinmap.io.ros2.arrays import Number, array_type, encode
from skinmap.io.ros2.bag_metadata import BAG_KEY, QOS_KEY, TopicFacts, bag_metadata, qos_profile
from skinmap.io.ros2.bag_metadata import METADATA as BAG_METADATA
from skinmap.io.ros2.definitions import definition, full_name
from skinmap.io.ros2.messages import TouchMarker, joints_message, text_message
from skinmap.io.ros2.robot_topics import JOINT_STATES, LATCHED, TYPES, RobotTopics
from skinmap.io.taxels.table import write_csv
from skinmap.skin.fingerprint import fingerprint
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin
from skinmap.skin.taxels import TaxelTable
from skinmap.touch.true_motion import TrueMotion

FORMAT = "skinmap-mcap-2"
METADATA = "skinmap"
REPAIRED = "repaired_lost_seconds"  # in the head of a file that was made from a damaged one
TOUCHES, MOTION = "/skin/touches", "/skin/motion"  # texts of JSON: docs/recordings.md
POINTS_HZ = 1.0  # clouds of all taxels: 16 bytes a taxel, which hardly compress
TOPICS: dict[tuple[Kind, Number], str] = {
    ("raw", "UInt8"): "/skin/raw",
    ("raw", "Float32"): "/skin/raw_float",
    ("pressure", "UInt8"): "/skin/pressure",
    ("pressure", "Float32"): "/skin/pressure_float",
}
TABLES = "skin/"  # attachments: skin/<part>.csv


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
    name, robot, manifest, clock : str
    fingerprints : mapping of str to str
        Of the skins, where no skin is given.
    skins : mapping of str to Skin
        Written into the file, so that it explains itself.
    samples : mapping of str to int
        How many of the first samples each part really has, where parts differ.
    session, person : str
        Of all touches that do not say otherwise.
    chunk_seconds : float
        Most that a killed process may lose.
    model : Robot, optional
        What ROS 2's tools draw: its description, transforms, and clouds of its taxels are written.
    points_hz : float
        Clouds a second at most; `inf` one with every sample, 0 none.

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
        name: str = "",
        robot: str = "",
        manifest: str = "",
        clock: str = "recording",
        fingerprints: Mapping[str, str] | None = None,
        skins: Mapping[str, Skin] | None = None,
        samples: Mapping[str, int] | None = None,
        session: str = "",
        person: str = "",
        chunk_seconds: float = CHUNK_SECONDS,
        model: Robot | None = None,
        points_hz: float = POINTS_HZ,
    ) -> None:
        self.path = path
        self.samples: dict[Kind, int] = dict.fromkeys(widths, 0)
        self._widths = {kind: tuple(each) for kind, each in widths.items()}
        self._parts = tuple(parts)
        self._ids: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._facts: dict[str, TopicFacts] = {}
        self._view: RobotView | None = None
        known = dict(fingerprints or {})
        known |= {part: fingerprint(skin) for part, skin in (skins or {}).items()}
        head = {
            "format": FORMAT,
            "name": name,
            "robot": robot,
            "manifest": manifest,
            "rate": repr(float(rate)),
            "clock": clock,
            "began": datetime.now(UTC).isoformat(timespec="seconds"),
            "chunk_seconds": repr(chunk_seconds),
            "parts": json.dumps(list(parts)),
            "widths": json.dumps(self._widths),
            "fingerprints": json.dumps(known),
            "samples": json.dumps(dict(samples or {})),
            "session": session,
            "person": person,
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
        if model is not None:
            topics = RobotTopics(model, self._parts, self._widths[self._shown], self._shown)
            self._view = RobotView(topics, self._message, points_hz)

    def _open_channels(self, shows_robot: bool) -> None:
        # The head stands in the channels too: a damaged page at the beginning cannot take it all.
        for (kind, number), topic in TOPICS.items():
            if kind in self._widths:
                self._open(topic, array_type(number), self._head)
        self._open(TOUCHES, "std_msgs/String", {})
        self._open(JOINT_STATES, TYPES[JOINT_STATES], {})
        if shows_robot:
            for topic, type_name in TYPES.items():
                if topic != JOINT_STATES:
                    self._open(topic, type_name, {})

    def _open(self, topic: str, kind: str, words: Mapping[str, str]) -> None:
        if kind not in self._schemas:
            text = definition(kind)
            self._schemas[kind] = self._writer.add_schema(full_name(kind), "ros2msg", text)
        qos = {QOS_KEY: qos_profile(latched=topic in LATCHED)}
        self._facts[topic] = TopicFacts(full_name(kind), latched=topic in LATCHED)
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
            No room; what was written stays readable.
        """
        channels = sum(self._widths[kind])
        if np.shape(values) != (channels,):
            raise SkinMismatchError(
                f"{self.path.name}: {kind} values of shape {np.shape(values)}, the skin has "
                f"{channels} channels"
            )
        number: Number = "UInt8" if whole_counts(values) else "Float32"
        message, stamp = encode(values, number), nanoseconds_of(time)
        self._message(TOPICS[kind, number], stamp, message, self.samples[kind])
        self.samples[kind] += 1
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

    def add_motion(self, time: float, touches: Sequence[Mapping[str, Any]]) -> None:
        """Write how touches move at the time of a sample [s], as docs/recordings.md has it."""
        if MOTION not in self._ids:
            with self._disk():
                self._open(MOTION, "std_msgs/String", {})
        text = json.dumps({"touches": list(touches)}, separators=(",", ":"))
        self._message(MOTION, nanoseconds_of(time), text_message(text), 0)

    def mark(
        self,
        part: str,
        event: int,
        label: str,
        *,
        began: float,
        ended: float | None = None,
        subject: int = 0,
        owners: Mapping[str, list[int]] | None = None,
        session: str = "",
        person: str = "",
        motion: TrueMotion | None = None,
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
        subject : int
            Who touched.
        owners : mapping of str to list of int
            Taxels of each touch that the label joins.
        session, person : str
            Where they are not those of the file.
        motion : TrueMotion, optional
            Its true way, presses and speed, where they are known.
        """
        content: dict[str, Any] = {"part": part, "event": event, "label": label, "began_s": began}
        content["subject"] = subject
        if ended is not None:
            content["ended_s"] = ended
        if owners:
            content["owners"] = owners
        said = {"session": session, "person": person}
        content |= {key: word for key, word in said.items() if word}
        if motion is not None:
            content["motion"] = {key: one.tolist() for key, one in motion.to_arrays().items()}
        stamp = nanoseconds_of(began if ended is None else ended)
        text = json.dumps(content, separators=(",", ":"))
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
            No room for the end; what was written stays readable.
        """
        if self._file.closed:
            return
        try:
            if self._view is not None and not self._writer.broken:
                self._view.end()
        finally:
            self._finish()

    def _finish(self) -> None:
        try:
            with self._disk():
                self._writer.finish({BAG_METADATA: {BAG_KEY: self.bag_metadata()}})
        finally:
            self._file.close()

    def bag_metadata(self) -> str:
        """What rosbag2 keeps of a bag beside its messages, as YAML."""
        return bag_metadata(self.path.name, self._facts)

    def _message(self, topic: str, stamp: int, content: bytes, sample: int) -> None:
        self._facts[topic].count(stamp)
        with self._disk():
            self._writer.add_message(self._ids[topic], stamp, content, sample)

    def _disk(self) -> _Disk:
        return _Disk(self.path)


class _Disk:
    """Says which file the system refused to write, and why."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, OSError) and not isinstance(error, OutputError):
            raise OutputError(
                f"cannot go on writing {str(self._path)!r}: {error.strerror}; what was written "
                f"stays readable"
            ) from None


def whole_counts(values: NDArray[Any]) -> bool:
    """Whether values are whole and lie in 0..255, so that a byte holds each."""
    if values.dtype == np.uint8:
        return True
    if not (values.min(initial=0) >= 0 and values.max(initial=0) <= 255):
        return False  # NaN too
    return bool((values == np.floor(values)).all())


def table_of(skin: Skin) -> bytes:
    """The taxels of a skin as our CSV."""
    table = TaxelTable(skin.channels, skin.modules, skin.positions, skin.normals, link=skin.link)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "skin.csv"
        write_csv(table, file)
        return file.read_bytes()


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
