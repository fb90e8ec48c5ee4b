"""What a foreign recording is of: a few lines of TOML beside it."""

from __future__ import annotations

import tomllib
import zipfile
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from skinmap.archive import open_arrays
from skinmap.errors import DataFormatError, MissingFileError
from skinmap.io.text import is_file, read_text
from skinmap.validation import checked

NAME = "mapping.toml"  # for all recordings of its folder and of the folders inside
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
    time_unit : {"s", "ms", "us"}, optional
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
    time_unit: Literal["s", "ms", "us"] | None = None
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
    """The mapping of a recording, None where there is none.

    It is `NAME.toml` beside it, else the `robot` and `part` inside a mended copy, else the nearest
    `mapping.toml` of the folders above it.

    Raises
    ------
    DataFormatError
        One that is damaged (says what and where).
    """
    beside = path.with_suffix(".toml")
    if is_file(beside) and "[robot]" not in read_text(beside):  # a manifest beside its taxels
        return read_mapping(beside)
    if (inside := _mapping_inside(path)) is not None:
        return inside
    for folder in path.absolute().parents[:LEVELS]:
        if is_file(folder / NAME):
            found = read_mapping(folder / NAME)
            return None if is_own_archive(path) else found
    return None


def _mapping_inside(path: Path) -> Mapping | None:
    """The mapping of a mended copy, which holds its robot and part as one word each."""
    if path.suffix.lower() != ".npz" or not is_file(path) or is_own_archive(path):
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
            f"a mapping that names the robot and the part of {path.name}, or {NAME} in its folder",
        )
    return found


def is_own_archive(path: Path) -> bool:
    """Whether a .npz is a Skinmap recording, or a damaged archive."""
    if path.suffix.lower() != ".npz":
        return False
    try:
        with zipfile.ZipFile(path) as whole:
            return not {"about.npy", "head.npy"}.isdisjoint(whole.namelist())
    except (OSError, zipfile.BadZipFile):
        return True


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
    fail = partial(DataFormatError, path=path)
    found = checked(table, Mapping, what="the mapping", fail=fail)
    if found.robot.endswith(".toml"):
        place = str(path.absolute().parent / found.robot)
        return msgspec.structs.replace(found, robot=place)
    return found
