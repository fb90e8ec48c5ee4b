"""Labelled recordings by the suffix of their file, ours and those of others, with plug-ins."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from skinmap.errors import MissingFileError, UnknownNameError, check_kind
from skinmap.io.mcap.reading import read_track
from skinmap.io.recordings.mapping import find_mapping
from skinmap.io.recordings.touch_files import SUFFIXES, load_recordings
from skinmap.io.robots.manifest import builtin_named
from skinmap.io.text import is_file
from skinmap.registry import Registry
from skinmap.touch.recording import Recording

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
    suffix = path.suffix.lower()
    return suffix in SUFFIXES or (suffix in FOREIGN and find_mapping(path) is not None)


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
    if not is_file(path):
        raise MissingFileError(path, "a recording made by `skinmap simulate` or `skinmap record`")
    mapping = find_mapping(path)
    said = format or (mapping.format if mapping is not None else None)
    suffix = path.suffix.lower()
    if said is None and suffix == ".npz" and mapping is not None:
        said = "arrays"
    if said is None and suffix in SUFFIXES:
        return load_recordings(path)
    said = said or FOREIGN.get(suffix)
    if said is None:
        check_kind(path, "a recording", *readable())
        raise UnknownNameError("recording format for files ending in", path.suffix, readable())
    return recording_readers.get(said)(path)


def recorded_robot(path: Path) -> str:
    """What `load_robot` loads the robot of a recording by; empty where nothing says.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or a damaged one.
    """
    suffix = path.suffix.lower()
    mapping = None if suffix == ".mcap" else find_mapping(path)
    if mapping is not None:
        return mapping.robot
    if suffix == ".mcap":
        track = read_track(path)
        return track.manifest or builtin_named(track.info.robot) or ""
    if suffix == ".npz":
        return next((one.robot for one in load_recordings(path) if one.robot), "")
    return ""
