"""Bags of ROS 2 that others recorded, by a mapping file that says which topic is which part.

The mapping of `run1` (a folder), `run1.mcap` or `run1.db3` is `run1.map.toml` beside it.
"""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, UnknownNameError, warn
from skinmap.io.mcap.writing import McapRecording, said_of
from skinmap.io.recordings.dumper import PartLog, side_by_side
from skinmap.io.recordings.recorded_stream import Kind, RecordedStream, seconds_of
from skinmap.io.robots.manifest import load_robot
from skinmap.io.ros2.messages import nanoseconds_of, points_of
from skinmap.io.text import read_toml
from skinmap.skin.robot import Robot
from skinmap.validation import checked, toml_table

MAPPING = ".map.toml"
METADATA = "metadata.yaml"
FILE = "recording.mcap"  # of a bag of ours
SUFFIXES = (".db3", ".mcap")
MAX_CHANNELS = 1_000_000
# Types of one value a pixel, by the encodings of `sensor_msgs/Image` (with their channels).
PIXELS = {
    "mono8": ("u1", 1), "8UC1": ("u1", 1), "mono16": ("u2", 1), "16UC1": ("u2", 1),
    "16SC1": ("i2", 1), "32SC1": ("i4", 1), "32FC1": ("f4", 1), "64FC1": ("f8", 1),
    "rgb8": ("u1", 3), "bgr8": ("u1", 3), "rgba8": ("u1", 4), "bgra8": ("u1", 4),
    "8UC3": ("u1", 3), "32FC3": ("f4", 3),
}  # fmt: skip


class _Topic(msgspec.Struct, forbid_unknown_fields=True):
    """A table `[[part]]`: whose values a topic brings."""

    name: str
    topic: str
    field: str | int = ""
    channels: list[Annotated[int, msgspec.Meta(ge=0)]] | None = None
    scale: float = 1.0
    offset: float = 0.0


class _Mapping(msgspec.Struct, forbid_unknown_fields=True):
    """A whole mapping file."""

    part: Annotated[list[_Topic], msgspec.Meta(min_length=1, max_length=1000)]
    kind: Kind = "raw"
    robot: str = ""
    time: Literal["header", "log"] = "header"


def mapping_of(bag: Path) -> Path:
    """Where the mapping file of a bag stands: beside it, or beside a link to it."""
    linked, own = (
        path.with_name(f"{path.stem if path.suffix.lower() in SUFFIXES else path.name}{MAPPING}")
        for path in (Path(os.path.abspath(bag)), bag.resolve())
    )
    return linked if linked.is_file() else own


def is_bag(path: Path) -> bool:
    """Whether a path looks like a bag of ROS 2 of others.

    That is a folder with its metadata, SQLite, or an MCAP file with a mapping file beside it.
    """
    suffix = path.suffix.lower()
    mapped = suffix == ".mcap" and mapping_of(path).is_file()
    return mapped or suffix == ".db3" or ((path / METADATA).is_file() and whole(path) == path)


def is_mapped(path: Path) -> bool:
    """Whether a path is a bag that can be read: one with its mapping file, or our own export."""
    return whole(path) != path or (is_bag(path) and mapping_of(path).is_file())


def whole(path: Path) -> Path:
    """The MCAP file of a bag of `write_rosbag2`, which needs no mapping; other paths unchanged."""
    own = path / FILE
    bare = (path / METADATA).is_file() and own.is_file() and not mapping_of(path).is_file()
    return own if bare else path


def recordings_under(folder: Path) -> list[Path]:
    """Files of a folder and of its folders, by their names; a bag counts as one, without its files.

    Bags without a mapping file are left out with a warning.
    """
    bags = {one.parent for one in folder.rglob(METADATA)} - {folder}
    files = [one for one in folder.rglob("*") if one.is_file() and bags.isdisjoint(one.parents)]
    several = sorted([*bags, *files])
    bare = [one for one in several if (one in bags or is_bag(one)) and not is_mapped(one)]
    if bare:
        warn(
            f"left out: {', '.join(str(one) for one in bare[:3])}{' ...' * (len(bare) > 3)}: bags "
            f"without a mapping file beside them, as {mapping_of(bare[0]).name}",
            above=1,
        )
    return [one for one in several if one not in bare]


def read_bag(bag: Path) -> RecordedStream:
    """Read a bag by the mapping file beside it.

    Parameters
    ----------
    bag : Path
        A folder with `metadata.yaml`, or a bare `.db3` or `.mcap`.

    Returns
    -------
    RecordedStream
        Several parts are given at the times of the one with most samples, each with what it last
        sent, as far as all of them were recorded.

    Raises
    ------
    MissingFileError, DataFormatError
        No mapping, or a bag or mapping that does not follow its format (says where).
    UnknownNameError
        A topic or field that the bag has not (lists those that exist).
    """
    mapping = read_bag_mapping(mapping_of(bag))
    track = side_by_side(bag.name, _read_topics(bag, mapping), mapping.kind, "", bag)
    robot = robot_of_bag(bag)
    name = load_robot(robot).name if robot and not robot.endswith(".toml") else ""
    return replace(track, info=replace(track.info, robot=name), manifest=robot)


def robot_of_bag(bag: Path) -> str:
    """What `load_robot` loads the robot of a bag by; a manifest's path begins at the mapping."""
    path = mapping_of(bag)
    said = read_bag_mapping(path).robot
    return str((path.parent / said).resolve()) if said.endswith(".toml") else said


def read_bag_parts(bag: Path) -> dict[str, PartLog]:
    """The samples of each part at its own times, in the order of the log; errors as `read_bag`."""
    return _read_topics(bag, read_bag_mapping(mapping_of(bag)))


def read_bag_mapping(path: Path) -> _Mapping:
    """Read a mapping file.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or one with a key or value that means nothing (named).
    """
    told = read_toml(path, "the mapping file of a bag: which topic is which part (docs/tools.md)")
    fail = partial(DataFormatError, path=path)
    mapping = checked(told, _Mapping, what="the mapping file", fail=fail, called=toml_table)
    names = [one.name for one in mapping.part]
    if len(set(names)) < len(names):
        raise DataFormatError(f"each part once, got {', '.join(names)}", path)
    for one in mapping.part:
        if not np.isfinite([one.scale, one.offset]).all():
            raise DataFormatError(f"{one.name!r}: scale and offset must be finite", path)
        if one.channels is not None and not 0 < len(one.channels) <= MAX_CHANNELS:
            raise DataFormatError(f"{one.name!r}: {len(one.channels)} channels", path)
        if one.channels is not None and len(set(one.channels)) < len(one.channels):
            raise DataFormatError(f"{one.name!r}: a channel given twice", path)
    return mapping


# Times of a message by its header (0 without) and the log [ns], its number of values, the chosen.
_Message = tuple[int, int, int, NDArray[Any]]


def _read_topics(bag: Path, mapping: _Mapping) -> dict[str, PartLog]:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    found: dict[str, list[_Message]] = {one.name: [] for one in mapping.part}
    try:
        # Bags of before 2023 hold no definitions: those of Humble are the standard ones.
        humble = get_typestore(Stores.ROS2_HUMBLE)
        with AnyReader([bag], default_typestore=humble) as reader:
            topics = {one.topic for one in reader.connections}
            for one in mapping.part:
                if one.topic not in topics:
                    raise UnknownNameError(f"topic in {bag.name}", one.topic, sorted(topics))
            wanted = {one.topic for one in mapping.part}
            chosen = [one for one in reader.connections if one.topic in wanted]
            for connection, stamp, data in reader.messages(chosen):
                message = reader.deserialize(data, connection.msgtype)
                head = getattr(message, "header", None)
                said = 0 if head is None else nanoseconds_of(head)
                for one in mapping.part:
                    if one.topic == connection.topic:
                        values = _values(message, one, bag)
                        found[one.name].append((said, stamp, len(values), _chosen(values, one)))
    except (UnknownNameError, DataFormatError):
        raise
    except Exception as error:  # rosbags, SQLite and decompressors raise their own kinds
        raise DataFormatError(f"not a bag that rosbags reads: {error}", bag) from error
    return {one.name: _stacked(one, found[one.name], mapping.time, bag) for one in mapping.part}


def _values(message: Any, one: _Topic, bag: Path) -> NDArray[Any]:
    """All values (n,) of one message."""
    kind = str(message.__msgtype__)
    if kind == "sensor_msgs/msg/PointCloud2":
        return _cloud_row(message, one, bag)
    if kind == "sensor_msgs/msg/Image":
        return _image_row(message, one, bag)
    if kind.endswith("MultiArray"):
        return np.asarray(message.data)[int(message.layout.data_offset) :]
    raise DataFormatError(
        f"{one.topic} holds {kind}; PointCloud2, Image and MultiArray are read", bag
    )


def _chosen(values: NDArray[Any], one: _Topic) -> NDArray[Any]:
    """The channels (k,) of a part, scaled; none where the message is too short."""
    if one.channels is not None:
        values = values[one.channels if max(one.channels) < len(values) else []]
    if (one.scale, one.offset) != (1.0, 0.0):
        values = values * one.scale + one.offset
    return values if values.dtype == np.uint8 else values.astype(np.float32)


def _cloud_row(message: Any, one: _Topic, bag: Path) -> NDArray[Any]:
    points = points_of(message)
    names = points.dtype.names or ()
    if one.field not in names:
        raise UnknownNameError(f"field in {one.topic} of {bag.name}", str(one.field), names)
    return np.asarray(points[one.field])


def _image_row(message: Any, one: _Topic, bag: Path) -> NDArray[Any]:
    """Pixels row by row, of the channel that `field` counts."""
    if message.encoding not in PIXELS:
        raise UnknownNameError(f"image encoding in {one.topic}", message.encoding, PIXELS)
    form, channels = PIXELS[message.encoding]
    kind = np.dtype(form).newbyteorder(">" if message.is_bigendian else "<")
    height, width, step = int(message.height), int(message.width), int(message.step)
    row_bytes = width * channels * kind.itemsize
    data = np.asarray(message.data, np.uint8)
    if step < row_bytes or len(data) < height * step:
        raise DataFormatError(f"an image of {len(data)} bytes in {one.topic}", bag)
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :row_bytes])
    pixels = rows.view(kind).reshape(height * width, channels)
    which = one.field if isinstance(one.field, int) else 0
    if not 0 <= which < channels:
        raise DataFormatError(f"channel {which} of an image with {channels} in {one.topic}", bag)
    return np.asarray(pixels[:, which])


def _stacked(one: _Topic, found: list[_Message], clock: str, bag: Path) -> PartLog:
    """Samples of a part in the order of the log; messages that are none are left out and named."""
    part = one.name
    if not found:
        raise DataFormatError(f"no message of {part!r}", bag)
    said, log, widths, rows = zip(*found, strict=True)
    width, count = Counter(widths).most_common(1)[0]
    if 2 * count <= len(widths) or not 0 < width <= MAX_CHANNELS:
        raise DataFormatError(f"samples of {part!r} have {sorted(set(widths))} values", bag)
    if one.channels is not None and max(one.channels) >= width:
        raise DataFormatError(f"channel {max(one.channels)} of {one.topic}, it has {width}", bag)
    sound = np.array(widths) == width
    values = np.array([row for row, fits in zip(rows, sound, strict=True) if fits])
    finite = np.isfinite(values).all(axis=1)
    if not finite.any():
        raise DataFormatError(f"samples of {part!r} hold NaN or infinity", bag)
    sound[sound] = finite
    stamps = _stamps(part, np.array(said), np.array(log), clock, bag)
    if not sound.all():
        first = int(np.flatnonzero(~sound)[0])
        warn(
            f"{bag.name}: {(~sound).sum()} of {len(sound)} messages of {part!r} hold NaN, infinity "
            f"or another number of values and were left out, first message {first}, "
            f"{stamps[first] - stamps[0]:.2f} s from the beginning",
            above=3,
        )
    stamps, values = stamps[sound], values[finite]
    if clock == "header" and len(set(said)) > 1:
        # Where others of one stamp differ, the clock is a coarse one and each is a sample; a log's
        # times are those of arrival.
        twice = np.append(False, np.diff(stamps) == 0.0)
        if twice.any() and (values[twice] == values[np.flatnonzero(twice) - 1]).all():
            warn(
                f"{bag.name}: {twice.sum()} of {len(twice)} messages of {part!r} repeat stamp and "
                "values of the one before and were left out: did two publishers send them?",
                above=3,
            )
            stamps, values = stamps[~twice], values[~twice]
    return stamps, values, ""


def _stamps(part: str, said: IntArray, log: IntArray, clock: str, bag: Path) -> FloatArray:
    """Times (t,) [s] of all messages by one clock: their headers' where all are set, or the log's.

    A log's own times may be those of another clock, so that none stands among a header's.
    """
    if log.min() < 0:
        raise DataFormatError(f"messages of {part!r} from before 1970", bag)
    if clock == "log" or not said.any():
        return seconds_of(log.astype(np.uint64))
    unset = int((said <= 0).sum())
    if not unset and (len(said) == 1 or said.min() < said.max()):
        return seconds_of(said.astype(np.uint64))
    wrong = f"{unset} of {len(said)} are not set" if unset else "all are the same"
    warn(
        f"{bag.name}: the headers of {part!r} give no times ({wrong}): those of the log are taken",
        above=4,
    )
    return seconds_of(log.astype(np.uint64))


def write_rosbag2(track: RecordedStream, folder: Path) -> None:
    """Write a bag; where the recording names its robot, with all that shows it.

    Raises
    ------
    OutputError
        The folder cannot be written to.
    """
    robot: Robot | None = load_robot(track.manifest) if track.manifest else None
    if len(track.times) and track.times[0] < 0:
        raise DataFormatError("its times begin before zero", folder)
    recording = McapRecording(
        folder / FILE,
        **said_of(track.info, robot) | {"robot": track.info.robot, "manifest": track.manifest},
        widths={track.kind: track.info.widths},
        samples=track.samples,
        model=robot,
        points_hz=float("inf"),
    )
    recording.add_all(track)
    (folder / METADATA).write_text(recording.bag_metadata())
