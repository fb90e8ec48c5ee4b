"""Labelled recordings by the suffix of their file: ours (.npz, .mcap), and by plug-ins others'.

A mapping, a few lines of TOML beside a foreign recording, names its robot, parts and units.
"""

from __future__ import annotations

import tomllib
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinmap.archive import open_arrays
from skinmap.errors import (
    DAMAGED_ARCHIVE,
    DataFormatError,
    InvalidArrayError,
    MissingFileError,
    SkinMismatchError,
    UnknownNameError,
    check_kind,
)
from skinmap.io.mcap.mcap_scan import scan_summary
from skinmap.io.mcap.reading import Index, read_head, read_track
from skinmap.io.mcap.writing import McapRecording, said_of
from skinmap.io.output import refused
from skinmap.io.recordings.dumper import PartLog, read_dump, read_logs
from skinmap.io.recordings.learning import track_of_arrays
from skinmap.io.recordings.recorded_stream import (
    RecordedStream,
    StreamInfo,
    part_events,
    taxel_columns,
    touches_of,
    warn_of_loss,
)
from skinmap.io.recordings.xdf import read_xdf, read_xdf_parts
from skinmap.io.robots.manifest import builtin_named
from skinmap.io.ros2.bag import is_bag, is_mapped, read_bag, read_bag_parts, robot_of_bag, whole
from skinmap.io.text import is_file, read_text
from skinmap.registry import Registry
from skinmap.skin.robot import Robot
from skinmap.touch import recording as archive
from skinmap.touch.recording import Recording
from skinmap.validation import checked

NAME = "mapping.toml"  # for all recordings of its folder and of the folders inside
HEAD = 4096  # bytes of the head of an archive, which hold its format
LEVELS = 3  # folders above a recording in which it is looked for
Positive = Annotated[float, msgspec.Meta(gt=0)]


class Mapping(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Which skin was recorded, and how its values read.

    Attributes
    ----------
    robot, part : str
        What `skinmap.load_robot` takes; a manifest's path begins at the mapping file.
    format : str, optional
        Where the suffix does not tell: a name of the recording formats.
    time : str
        Column of the times.
    time_unit : {"s", "ms", "us", "ns"}, optional
        Seconds where nothing is stated.
    rate_hz : float, optional
        Samples a second where there is no column of times.
    columns : tuple of str
        Names of the columns of a table without a header.
    channels : dict of str to int
        Channel of the skin by column; by the number in the column's name where it is empty.
    rest_percentile : float, optional
        Share of the time that a channel rests [%]: what it reads then is taken away.
    full_scale : float
        Value above rest that is a pressure of 255.
    falling : bool
        Whether values fall under load.
    label, person, session : str
        Of all touches of the file.
    label_column, person_column, session_column, event_column : str, optional
        Columns that say so for each sample.
    label_from : {"folder", "name"}, optional
        The label is the name of the file's folder, or its own.
    """

    robot: str
    part: str
    format: str | None = None
    time: str = "time"
    time_unit: Literal["s", "ms", "us", "ns"] | None = None
    rate_hz: Positive | None = None
    columns: tuple[str, ...] = ()
    channels: dict[str, Annotated[int, msgspec.Meta(ge=0)]] = {}
    rest_percentile: Annotated[float, msgspec.Meta(ge=0, le=100)] | None = None
    full_scale: Positive = 255.0
    falling: bool = False
    label: str = ""
    person: str = ""
    session: str = ""
    label_column: str | None = None
    person_column: str | None = None
    session_column: str | None = None
    event_column: str | None = None
    label_from: Literal["folder", "name"] | None = None

    def label_of(self, path: Path) -> str:
        """The label that all samples of a file have; empty where none is said."""
        if self.label_from is None:
            return self.label
        return path.parent.name if self.label_from == "folder" else path.stem


def find_mapping(path: Path) -> Mapping | None:
    """The mapping of a recording, None where there is none or a recording of Skinmap needs none.

    It is `NAME.toml` beside it, else the `robot` and `part` inside a mended copy, else the nearest
    `mapping.toml` of the folders above it.

    Raises
    ------
    DataFormatError
        One that is damaged (says what and where).
    """
    if is_own_archive(path, damaged=False):
        return None
    beside = path.with_suffix(".toml")
    if is_file(beside) and "[robot]" not in read_text(beside):  # a manifest beside its taxels
        return read_mapping(beside)
    if is_own_archive(path):
        return None
    if (inside := _mapping_inside(path)) is not None:
        return inside
    for folder in path.absolute().parents[:LEVELS]:
        if is_file(folder / NAME):
            return read_mapping(folder / NAME)
    return None


def _mapping_inside(path: Path) -> Mapping | None:
    """The mapping of a mended copy, which holds its robot and part as one word each."""
    if path.suffix.lower() != ".npz" or not is_file(path):
        return None
    with open_arrays(path, "an NPZ of channels over time") as arrays:
        if not {"robot", "part", "samples", "mended"} <= set(arrays):
            return None
        named = arrays["robot"], arrays["part"]
        if any(one.dtype.kind != "U" or one.size != 1 for one in named):
            return None
        return Mapping(str(named[0].item()), str(named[1].item()))


def needed_mapping(path: Path) -> Mapping:
    """The mapping of a file that says nothing of its skin.

    Raises
    ------
    MissingFileError
        There is none.
    """
    found = find_mapping(path)
    if found is None:
        raise MissingFileError(
            path.with_suffix(".toml"),
            f"a mapping that names the robot and the part of {path.name}, with lines such as "
            f'robot = "icub" and part = "torso" (docs/own_recordings.md), or {NAME} in its folder',
        )
    return found


def is_own_archive(path: Path, *, damaged: bool = True) -> bool:
    """Whether a .npz has the head of a Skinmap recording; `damaged` of a damaged archive."""
    if path.suffix.lower() != ".npz":
        return False
    try:
        with zipfile.ZipFile(path) as whole:
            for name in {"about.npy", "head.npy"} & {*whole.namelist()}:
                with whole.open(name) as head:
                    if b"skinmap-" in head.read(HEAD).replace(b"\0", b""):
                        return True
    except DAMAGED_ARCHIVE:
        return damaged
    return False


def read_mapping(path: Path) -> Mapping:
    """A mapping file.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, no TOML, or keys that are wrong.
    """
    try:
        table = tomllib.loads(read_text(path))
    except (ValueError, RecursionError) as error:  # huge numbers, deep nests are no TOML errors
        raise DataFormatError(f"not a mapping of a recording: {error}", path) from None
    if isinstance(table.get("robot"), dict):
        raise DataFormatError("is a manifest, not a mapping of a recording", path)
    found = checked(table, Mapping, what="the mapping", fail=partial(DataFormatError, path=path))
    if found.robot.endswith(".toml"):
        return msgspec.structs.replace(found, robot=str(path.absolute().parent / found.robot))
    return found


SUFFIXES = (".npz", ".mcap")
HOW = "`skinmap export FILE -o touches.npz` and a mapping make one of others' files"
SAVED_CHUNK = 10.0  # [s]; nothing is saved piece by piece, so chunks close by size
LOST = 0.1  # share of samples that a part may have lost beside the others
SAME_TIME = 1e-6  # [s]; parts that are recorded together agree within it


def load_recordings(path: str | Path) -> list[Recording]:
    """Read labelled pressures of each part.

    Parameters
    ----------
    path : str or Path
        A file of `save_recordings`, `skinmap simulate`, `record` or `export`: .npz or .mcap; or
        others' arrays (.npz) with a mapping.

    Returns
    -------
    list of Recording
        One a part.

    Raises
    ------
    MissingFileError
        No such file.
    DataFormatError
        It is damaged, or holds no pressures.
    UnknownNameError
        A suffix that no reader has.

    Examples
    --------
    >>> import skinmap
    >>> skin = skinmap.load_robot("kaspar").skin("left_hand")
    >>> skinmap.save_recordings(skinmap.simulate(skin, per_gesture=1, rng=0), "touches.npz")
    >>> [recording.part for recording in skinmap.load_recordings("touches.npz")]
    ['left_hand']
    """
    path = Path(path)
    if not is_file(path):
        raise MissingFileError(path, "a recording made by `skinmap simulate` or `skinmap record`")
    check_suffix(path)
    npz = path.suffix.lower() == ".npz"
    if npz and find_mapping(path) is not None:
        return read_recordings(path)
    track = exported_track(path) if npz else warn_of_loss(read_track(path), path)
    return archive.load_recordings(path) if track is None else recordings_of(track, path)


def exported_track(path: Path) -> RecordedStream | None:
    """The whole recording of a .npz of `skinmap export`: joints, taxels and raw values, too.

    None for what `save_recordings` wrote.

    Raises
    ------
    DataFormatError
        Neither of the two.
    """
    with open_arrays(path, "a Skinmap recording") as arrays:
        if "about" in arrays:
            return track_of_arrays(arrays, path)
        if "head" not in arrays:
            raise DataFormatError(f"not a Skinmap recording: {arrays.files[:4]}. {HOW}", path)
    return None


def check_suffix(path: Path) -> None:
    """Refuse a file name whose suffix is no format of recordings.

    Raises
    ------
    UnknownNameError
        Says which there are.
    """
    if path.suffix.lower() not in SUFFIXES:
        check_kind(path, "a recording", *SUFFIXES)
        raise UnknownNameError("recording format for files ending in", path.suffix, SUFFIXES)


def save_recordings(
    recordings: Recording | Sequence[Recording],
    path: str | Path,
    *,
    suffix: str | None = None,
    robot: Robot | None = None,
) -> None:
    """Write labelled pressures; in MCAP with the skins of the robot they were recorded on.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
        One a part. In MCAP they share their times: a shorter one is known to end sooner.
    path : str or Path
        Ends in .npz or .mcap. A file that is there is replaced.
    suffix : str, optional
        Format, where the path's own suffix does not tell.
    robot : Robot, optional
        Whose skins are written too, in MCAP.

    Raises
    ------
    UnknownNameError
        A suffix that no writer has.
    SkinMismatchError
        Parts that cannot stand in one MCAP file: another time for the same sample.
    InvalidArrayError
        No recording.
    OutputError
        The file cannot be written.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> touches = skinmap.simulate(robot.skin("left_hand"), per_gesture=1, rng=0)
    >>> skinmap.save_recordings(touches, "touches.mcap", robot=robot)
    >>> skinmap.load_recordings("touches.mcap")[0].labels == touches.labels
    True
    """
    recordings = [recordings] if isinstance(recordings, Recording) else recordings
    path = Path(path)
    name = path if suffix is None else path.with_suffix(suffix)
    if name.suffix.lower() not in SUFFIXES:
        raise UnknownNameError("format to write recordings in for files ending in", name.suffix,
                               SUFFIXES)  # fmt: skip
    if not recordings:
        raise InvalidArrayError("no recording to write")
    if robot is not None:
        recordings = [replace(one, robot=one.robot or robot.origin) for one in recordings]
    if name.suffix.lower() == ".npz":
        with refused(repr(str(path))):
            archive.save_recordings(list(recordings), path)
        return
    track = track_of(recordings, path)
    McapRecording(
        path,
        **said_of(replace(track.info, name="", fingerprints={}), robot),
        widths={"pressure": track.info.widths},
        samples=track.samples,
        chunk_seconds=SAVED_CHUNK,
    ).add_all(track)


def _longest(recordings: Sequence[Recording]) -> Recording:
    """The recording whose times are those of all."""
    longest = max(recordings, key=lambda one: len(one.times))
    for one in recordings:
        if not np.allclose(one.times, longest.times[: len(one.times)], rtol=0, atol=SAME_TIME):
            raise SkinMismatchError(
                f"{one.part!r} and {longest.part!r} were sampled at other times, so they do not "
                f"stand beside each other; choose one part"
            )
    return longest


def at_one_clock(recordings: Sequence[Recording]) -> list[Recording]:
    """Parts of which some lost a few samples, at the times of the longest: the last one stands.

    Parts that were sampled at other times are left as they are.
    """
    longest = max((one.times for one in recordings), key=len, default=np.zeros(0))
    found = []
    for one in recordings:
        times = longest[longest <= one.times.max(initial=-np.inf) + SAME_TIME]
        rows = np.searchsorted(one.times, times + SAME_TIME, side="right").clip(1) - 1
        lost = np.abs(times - one.times[rows]) > SAME_TIME
        if len(times) and 0.0 < lost.mean() < LOST and one.forces is None and one.places is None:
            one = replace(one, times=times, pressures=one.pressures[rows],
                          events=one.events[rows])  # fmt: skip
        found.append(one)
    return found


def track_of(recordings: Sequence[Recording], path: Path) -> RecordedStream:
    """Recordings of several parts beside each other; a shorter one rests at zero in the end.

    Raises
    ------
    DataFormatError
        No recording.
    SkinMismatchError
        Parts that were sampled at other times.
    """
    if not recordings:
        raise DataFormatError("no recording in it", path)
    longest = _longest(recordings)
    widths = tuple(one.pressures.shape[1] for one in recordings)
    values = np.zeros((len(longest.times), sum(widths)), np.uint8)
    for one, end in zip(recordings, np.cumsum(widths).tolist(), strict=True):
        values[: len(one.times), end - one.pressures.shape[1] : end] = one.pressures
    parts = tuple(one.part for one in recordings)
    known = {one.part: one.fingerprint for one in recordings if one.fingerprint}
    return RecordedStream(
        StreamInfo(path.name, parts, widths, 0.0, fingerprints=known),
        longest.times,
        values,
        touches=tuple(touch for one in recordings for touch in touches_of(one.part, one)),
        samples={one.part: len(one.times) for one in recordings},
        manifest=next((one.robot for one in recordings if one.robot), ""),
    )


def recordings_of(track: RecordedStream, path: Path) -> list[Recording]:
    """The pressures of each part, with what touched it.

    Raises
    ------
    DataFormatError
        Raw values, values beyond 0..255, or a part whose taxels are not known.
    """
    if track.kind != "pressure":
        raise DataFormatError(
            "holds raw values only; record pressures (`skinmap record` with --model or --label)",
            path,
        )
    pressures = _counts(track, path)
    found = []
    for part in track.parts:
        count = min(track.samples.get(part, len(pressures)), len(pressures))
        columns = pressures[:count, track.columns(part)]
        table = track.tables.get(part)
        channels = None if table is None else table.channels
        columns = columns[:, taxel_columns(channels, columns.shape[1], part, path)]
        touches = [one for one in track.touches if one.part == part]
        marked = part_events(touches, count, columns.shape[1], path)
        found.append(
            Recording(
                part,
                track.times[:count],
                columns,
                robot=track.manifest or builtin_named(track.info.robot) or "",
                fingerprint=track.info.fingerprints.get(part, ""),
                **marked.known(),
            )
        )
    return found


def _counts(track: RecordedStream, path: Path) -> NDArray[np.uint8]:
    pressures = np.empty((len(track.times), track.info.channels), np.uint8)
    for rows, values in track.blocks():
        outside = ~((values >= 0) & (values <= 255))
        if outside.any():
            row, channel = np.argwhere(outside)[0]
            raise DataFormatError(
                f"sample {rows.start + row} holds {values[row, channel]} at channel {channel}; "
                f"pressures are 0 to 255",
                path,
            )
        pressures[rows] = np.rint(values)
    return pressures


RecordingReader = Callable[[Path], list[Recording]]
recording_readers: Registry[RecordingReader] = Registry(
    "recording format",
    "skinmap.recording_readers",
    built_in={
        "table": "skinmap.io.recordings.channel_table:read_table",
        "arrays": "skinmap.io.recordings.channel_table:read_arrays",
        "cyskin": "skinmap.io.recordings.channel_table:read_cyskin_text",
    },
)
# Formats of others say nothing of their skin: a mapping file beside them names it.
FOREIGN: dict[str, str] = {".csv": "table", ".tsv": "table", ".txt": "cyskin"}


def readable() -> tuple[str, ...]:
    """The suffixes that recordings have."""
    return (*SUFFIXES, *FOREIGN)


def is_readable(path: Path) -> bool:
    """Whether a file in a folder is a recording: one of ours, or one with a mapping beside it."""
    return path.suffix.lower() in SUFFIXES or is_mapped(path) or is_foreign(path)


def is_foreign(path: Path) -> bool:
    """Whether a file is a recording of other software, with a mapping that names its skin."""
    return path.suffix.lower() in (*FOREIGN, ".npz") and find_mapping(path) is not None


def read_recordings(path: Path, format: str | None = None) -> list[Recording]:
    """Pressures of each part and what touched it, in the format named or that of the file.

    Parameters
    ----------
    path : Path
    format : str, optional
        A name of `recording_readers`; a mapping file may name it too.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, one that does not follow its format, or no mapping file beside it.
    UnknownNameError
        A suffix or a format that no reader has.
    """
    path = whole(path)
    if format is None and path.exists() and (track := read_streams(path)) is not None:
        return recordings_of(warn_of_loss(track, path), path)
    if not is_file(path):
        raise MissingFileError(path, "a recording made by `skinmap simulate` or `skinmap record`")
    mapping = find_mapping(path)
    said = format or (mapping.format if mapping is not None else None)
    suffix = path.suffix.lower()
    if said is None and (mapping is not None or not is_own_archive(path)):
        said = "arrays" if suffix == ".npz" else FOREIGN.get(suffix)
    if said is not None:
        return recording_readers.get(said)(path)
    if suffix in SUFFIXES:
        return load_recordings(path)
    check_kind(path, "a recording", *readable())
    raise UnknownNameError("recording format for files ending in", path.suffix, readable())


def part_logs(path: Path) -> dict[str, PartLog] | None:
    """Each part at its own times, of a bag of ROS 2, XDF or a data dumper; None of other formats.

    Raises
    ------
    MissingFileError, DataFormatError, UnknownNameError
        No such file, no mapping of a bag, or one that does not follow its format.
    """
    path, suffix = whole(path), path.suffix.lower()
    if is_bag(path):
        return read_bag_parts(path)
    if suffix == ".xdf":
        return read_xdf_parts(path)
    return read_logs(path) if path.is_dir() or suffix == ".log" else None


def read_streams(path: Path, robot: Robot | None = None) -> RecordedStream | None:
    """All parts of such a recording at the same times; None of other formats.

    Arguments and errors as those of `part_logs`, `read_xdf` and `read_dump`.
    """
    suffix = path.suffix.lower()
    if is_bag(path):
        return read_bag(path)
    if suffix == ".xdf":
        return read_xdf(path, robot=robot)
    return read_dump(path, robot=robot) if path.is_dir() or suffix == ".log" else None


def recorded_robot(path: Path) -> str:
    """What `load_robot` loads the robot of a recording by; empty where nothing says.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or a damaged one.
    """
    path = whole(path)
    if is_bag(path):
        return robot_of_bag(path)
    suffix = path.suffix.lower()
    mapping = None if suffix == ".mcap" or path.is_dir() else find_mapping(path)
    if mapping is not None:
        return mapping.robot
    if suffix == ".mcap":
        head = read_head(scan_summary(path) or Index(path).found)
        return head.get("manifest") or builtin_named(head.get("robot", "")) or ""
    if suffix == ".npz":
        return next((one.robot for one in load_recordings(path) if one.robot), "")
    return ""
