"""Any recording as one table of channels over time, without a mapping to a skin."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinmap.archive import read_arrays
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import (
    DataFormatError,
    MissingFileError,
    SkinError,
    SkinMismatchError,
    check_kind,
)
from skinmap.io.recordings.channel_table import (
    SECONDS,
    channel_columns,
    first_of,
    is_number,
    table_columns,
    text_rows,
    whole_numbers,
    words_of,
)
from skinmap.io.recordings.touch_files import Mapping as FileMapping
from skinmap.io.recordings.touch_files import find_mapping, is_own_archive
from skinmap.io.text import check_file

if TYPE_CHECKING:
    from skinmap.skin.robot import Robot

MAX_BYTES = 2**32
MOST_CHANNELS = 20_000
SAMPLES = ("samples", "values", "counts", "pressures", "taxels", "data")
TIMES = ("times", "time", "t", "timestamps", "timestamp", "stamps")
IDS = ("channels", "taxel_ids", "ids", "channel_ids")
EVENTS = ("events", "event")
PRESSURE = {"pressure_bar": 1e5, "pressure_kpa": 1e3, "pressure_pa": 1.0}
# Columns of a table.
WORDS = {"label": "labels", "gesture": "labels", "session": "sessions", "person": "people"}
UNITS = {1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
UNSURE = "seconds or milliseconds"
QUICK, SLOW = 0.9, 2.05  # steps of 1 or 2 ms, or of seconds: skins send at both rates
FAR = 10.0  # between parts of which no pose is known [m]
TABLES = (".csv", ".tsv", ".txt")
ARRAYS = (".npz", ".mat")
STREAMS = (".mcap", ".xdf", ".db3", ".log")


@dataclass(frozen=True, eq=False, slots=True)
class Track:
    """Channels over time, as a file has them.

    Attributes
    ----------
    file : str
    values : (t, n) number
    times : (t,) float or None
        [s].
    unit : str
        Unit that the times had, where it was not seconds; empty otherwise.
    ids : (n,) int or None
        Number that the file gives each channel.
    events : (t,) int
        Touch of each row, -1 for none.
    labels, sessions, people : tuple of str
        Of each touch; empty where the file has none.
    stretches : (t,) int or None
        Files that were joined, each with times of its own.
    reference : (u,) float or None
        Pressure [Pa] of another instrument.
    reference_times : (u,) float or None
        [s].
    places : (n, 3) float or None
        Of the channels on the skin [m]; NaN for a channel without a place.
    marks : tuple of dict
        Faults (`kind`, `channels`, `rows`) that a mended copy holds as marks.
    part : str
        Of the robot, several separated by commas; empty where the file does not tell.
    robot : str
        What `skinmap.load_robot` loads it by, of pressures; empty where the file does not tell.
    names : tuple of str
        Of columns, by id, where a name stands twice.
    """

    file: str
    values: NDArray[Any]
    times: FloatArray | None = None
    unit: str = ""
    ids: IntArray | None = None
    events: IntArray | None = None
    labels: tuple[str, ...] = ()
    sessions: tuple[str, ...] = ()
    people: tuple[str, ...] = ()
    stretches: IntArray | None = None
    reference: FloatArray | None = None
    reference_times: FloatArray | None = None
    places: FloatArray | None = None
    marks: tuple[dict[str, Any], ...] = ()
    part: str = ""
    robot: str = ""
    names: tuple[str, ...] = ()


def files_of(path: Path) -> list[Path]:
    """The recordings that a path names: itself, or those in a folder.

    Raises
    ------
    MissingFileError, DataFormatError
        Nothing there, or a folder without recordings.
    """
    if not path.exists():
        raise MissingFileError(path, "a recording, or a folder of recordings")
    if not path.is_dir():
        return [path]
    from skinmap.io.ros2.bag import METADATA, is_mapped, recordings_under

    if (path / METADATA).is_file() or (path / "data.log").is_file():
        return [path]
    known = (*TABLES, *ARRAYS, *STREAMS)
    found = [
        one
        for one in recordings_under(path)
        if (one.suffix.lower() in known or is_mapped(one)) and not one.name.startswith(".")
    ]
    logs = {one.parent.parent for one in found if one.name == "data.log"}
    found = [one for one in found if one.name != "data.log"] + sorted(logs)
    if not found:
        raise DataFormatError(f"a folder without recordings ({', '.join(known)})", path)
    return found


def read_track(path: Path) -> Track:
    """Read a recording of any format.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or one without a table of channels over time (names the reason).
    """
    suffix = path.suffix.lower()
    if path.is_dir() or suffix in STREAMS:
        track = _from_stream(path)
    elif suffix in ARRAYS:
        check_file(path, "an NPZ or MAT file of channels over time", MAX_BYTES)
        track = _from_arrays(path, read_arrays(path) if suffix == ".npz" else _mat(path))
    elif suffix in TABLES:
        track = _from_table(path)
    else:
        check_kind(path, "a recording")
        known = ", ".join((*ARRAYS, *TABLES, *STREAMS))
        raise DataFormatError(f"no recording format ends in {suffix!r}; known: {known}", path)
    return check_track(track)


def check_track(track: Track) -> Track:
    """Refuse a table in which nothing can be examined.

    Raises
    ------
    DataFormatError
        No rows or one, no channels or one, too many, or no finite number.
    """
    count, width = track.values.shape
    fail = None
    if count < 2 or width == 0:
        fail = f"{count} rows of {width} channels; an examination needs 2 rows or more"
    elif width == 1:
        fail = "one channel; an examination compares channels and needs 2 or more"
    elif width > MOST_CHANNELS:
        fail = f"{width} channels; at most {MOST_CHANNELS} are examined"
    elif track.values.dtype.kind == "f" and not any(
        np.isfinite(track.values[start : start + 4096]).any() for start in range(0, count, 4096)
    ):
        fail = "no finite number in any sample"
    if fail:
        raise DataFormatError(fail, track.file)
    return track


def _mat(path: Path) -> dict[str, NDArray[Any]]:
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = loadmat(path, squeeze_me=False, chars_as_strings=True)
    except NotImplementedError as error:
        raise DataFormatError("a MAT file of version 7.3; save it with -v7", path) from error
    except Exception as error:
        raise DataFormatError(f"not a MAT file: {str(error)[:200]}", path) from error
    held = {name: np.asarray(one) for name, one in found.items() if not name.startswith("__")}
    return {name: _unboxed(one) for name, one in held.items()}


def _unboxed(array: NDArray[Any]) -> NDArray[Any]:
    """An array of MATLAB: cells of words as words; vectors with one dimension."""
    if array.dtype.kind == "O":
        array = np.array([str(np.squeeze(one)) for one in array.ravel()])
    return array.ravel() if array.ndim == 2 and 1 in array.shape else array


def _from_arrays(path: Path, held: dict[str, NDArray[Any]]) -> Track:
    name = next((one for one in SAMPLES if one in held), None)
    if name is None:
        name = max(
            (one for one in held if held[one].ndim == 2 and held[one].dtype.kind in "buif"),
            key=lambda one: held[one].size,
            default=None,
        )
    if name is None:
        there = ", ".join(sorted(held)) or "none"
        only = "a reference only: " if any(one in held for one in PRESSURE) else ""
        raise DataFormatError(
            f"{only}no array `samples` (t, n), one row a sample; its arrays: {there}", path
        )
    values = held[name]
    if values.ndim == 1 and values.dtype.kind in "buif" and len(values) > 1:
        values = values[:, None]
    if values.ndim != 2 or values.dtype.kind not in "buif":
        raise DataFormatError(
            f"`{name}` holds {values.dtype} of shape {values.shape}; numbers (t, n) expected", path
        )
    count, width = values.shape
    times, unit = _times(first_of(held, TIMES), values, path)
    if times is None and "first_columns" in held and held["first_columns"].ndim == 2:
        times, unit = _times(held["first_columns"][:, -1], values, path)
    stretches = whole_numbers(held.get("file_index"), "file_index", count, path)
    events = whole_numbers(first_of(held, EVENTS), "events", count, path)
    events = stretches if events is None else events
    labels = words_of(held.get("labels", held.get("file_class")))
    if events is None and len(labels) == count:  # a label of each row
        events = _runs(labels)
        labels = _fitted(labels, events)
    words = {
        name: _fitted(words_of(held.get(name)), events, len(labels))
        for name in ("sessions", "people")
    }
    _check_words(events, labels, words, path)
    reference = next((held[one] * scale for one, scale in PRESSURE.items() if one in held), None)
    if reference is not None and (reference.ndim != 1 or reference.dtype.kind not in "uif"):
        raise DataFormatError("the reference pressure is not a list of numbers", path)
    reference_times = held.get("reference_times")
    if reference is not None and reference_times is not None:
        reference_times, _ = _times(reference_times, reference[:, None], path, "reference_times")
    places = held.get("positions")
    known = places is not None and places.shape == (width, 3) and places.dtype.kind in "uif"
    return Track(
        str(path),
        values,
        times,
        unit,
        whole_numbers(first_of(held, IDS), "channels", width, path),
        events,
        labels,
        words["sessions"],
        words["people"],
        stretches,
        None if reference is None else np.asarray(reference, np.float64),
        reference_times if reference is not None else None,
        np.asarray(places, np.float64) if known else None,
        _marks(held.get("marks"), path),
        part=_word("part", held),
        robot=_word("robot", held),
    )


def _fitted(own: tuple[str, ...], events: IntArray | None, labels: int = 0) -> tuple[str, ...]:
    """Words of a whole file, or of each of its rows, as one for each label, or each event."""
    if labels and len(own) == 1:
        return own * labels
    if events is None or len(own) != len(events) or len(own) == labels:
        return own
    first = dict(zip(events[::-1].tolist(), own[::-1], strict=True))  # at each begin
    return tuple(first.get(k, "") for k in range(labels or int(events.max(initial=-1)) + 1))


def _check_words(
    events: IntArray | None,
    labels: tuple[str, ...],
    words: Mapping[str, tuple[str, ...]],
    path: Path,
) -> None:
    """Refuse events without a label, and sessions or people that are not one for each label."""
    last = -1 if events is None else int(events.max(initial=-1))
    if labels and last >= len(labels):
        raise DataFormatError(
            f"events name touch {last}, `labels` has {len(labels)}: one for each touch, from 0",
            path,
        )
    for name, own in words.items():
        if labels and own and len(own) != len(labels):
            raise DataFormatError(f"`{name}` has {len(own)}, `labels` {len(labels)}", path)


def _marks(found: NDArray[Any] | None, path: Path) -> tuple[dict[str, Any], ...]:
    """The marks of a mended copy."""
    if found is None or found.dtype.kind != "U":
        return ()
    try:
        several = [json.loads(str(one)) for one in found.ravel()]
        return tuple({name: one[name] for name in ("kind", "channels", "rows")} for one in several)
    except (ValueError, LookupError, TypeError):
        raise DataFormatError("its marks are damaged", path) from None


def _word(name: str, held: Mapping[str, NDArray[Any]]) -> str:
    """A word that a mended copy holds; other files may call anything by its name."""
    found = held.get(name) if "mended" in held else None
    alone = found is not None and found.dtype.kind == "U" and found.size == 1
    return "".join(words_of(found)) if alone else ""


def _runs(labels: tuple[str, ...]) -> IntArray:
    """Events of stretches of rows with the same label; an empty one is no touch."""
    keys = np.array(labels)
    touched = ~np.isin(keys, ("", "none", "nan", "-1", "rest"))
    begins = touched & np.append(True, keys[1:] != keys[:-1])
    return np.where(touched, np.cumsum(begins) - 1, -1)


def _times(
    found: NDArray[Any] | None, values: NDArray[Any], path: Path, name: str = "times"
) -> tuple[FloatArray | None, str]:
    """Seconds of each row, and the unit that they had in the file where it was another."""
    if found is None:
        return None, ""
    count = len(values)
    if found.dtype.kind == "M":
        found = found.astype("datetime64[ns]").astype(np.int64) / 1e9
    if found.dtype.kind not in "uif":
        raise DataFormatError(f"{name} are text, not numbers: {found.ravel()[:1].tolist()}", path)
    if found.shape != (count,):
        raise DataFormatError(f"{name} of shape {found.shape} for {count} rows", path)
    if found.dtype.kind == "f" and not np.isfinite(found).all():
        row = int(np.flatnonzero(~np.isfinite(found))[0])
        raise DataFormatError(f"row {row} has no finite time", path)
    exact = found.astype(np.float64) if found.dtype.kind == "f" else found - found.min()
    steps = np.diff(exact)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    scale, unit = _unit(step, float(found.max(initial=0)), values)
    return exact.astype(np.float64) * scale, unit


def _unit(step: float, last: float, values: NDArray[Any]) -> tuple[float, str]:
    """Seconds in one of the file's, and its name where it is another or open."""
    scales = (1.0, *UNITS)
    for scale in scales:
        if 1e9 < last * scale < 2.5e9 and 1e-4 < step * scale < 10.0:  # since 1970
            return scale, UNITS.get(scale, "")
    # Skins send 1 to 1,000 samples a second: a step of 20 is 20 ms, of 20,000 is 20 us apart.
    which = sum(step >= QUICK * 1000.0**k for k in range(3))
    if which == 1 and step <= SLOW:
        return 1.0, "" if _leaps(values) else UNSURE
    return scales[which], UNITS.get(scales[which], "")


def _leaps(values: NDArray[Any]) -> bool:
    """Whether touches rise within a row, as they do at a few Hz, not at hundreds."""
    few = np.nan_to_num(values[:5000].astype(np.float64))
    total = np.abs(few - np.median(few, axis=0)).sum(axis=1)
    steps, span = np.abs(np.diff(total)), np.ptp(np.percentile(total, (5.0, 99.5)))
    loud = span > 20.0 * np.median(steps)  # noise leaps too
    return bool(loud and (steps > 0.3 * span).sum() >= 5)


def _from_table(path: Path) -> Track:
    check_file(path, "a table of channels over time", MAX_BYTES)
    mapping = find_mapping(path)
    columns = () if mapping is None else mapping.columns
    rows = text_rows(path, columns, thousands=False)
    _, names = next(rows)
    if not any(names):
        raise DataFormatError("empty", path)
    if not columns and all(is_number(one) for one in names if one):
        raise DataFormatError(
            "no header: a column `time` and a name for each channel expected", path
        )
    known = _named_columns(mapping)
    beside = [k for k, one in enumerate(names) if one.lower() in (*known, *known.values())]
    numbers = [k for k in range(len(names)) if k not in beside]
    table, said = table_columns(rows, names, numbers, beside, path, gaps=True)
    if not len(table):
        raise DataFormatError("a header and no rows", path)
    lower = [names[k].lower() for k in numbers]
    ours: tuple[tuple[str, ...], ...] = (TIMES, EVENTS)
    if mapping is not None:
        ours = (mapping.time.lower(),), ((mapping.event_column or EVENTS[0]).lower(),)
    clock, event = (next((k for k, one in enumerate(lower) if one in own), None) for own in ours)
    kept = [k for k in range(len(numbers)) if k not in (clock, event)]
    if mapping is not None and mapping.channels:
        kept = [k for k in kept if names[numbers[k]] in mapping.channels]
    held: dict[str, NDArray[Any]] = {"samples": table[:, kept]}
    held |= {known.get(names[k].lower(), names[k].lower()): np.array(o) for k, o in said.items()}
    if clock is not None:
        held["times"] = table[:, clock]
    events = None if event is None else whole_numbers(table[:, event], "event", len(table), path)
    if events is not None:
        held["events"] = events
        held["labels"] = np.array(_fitted(words_of(held.get("labels")), events), np.str_)
    track = _from_arrays(path, held)
    if mapping is not None and clock is not None and mapping.time_unit is not None:
        track = replace(track, times=table[:, clock] * SECONDS[mapping.time_unit], unit="")
    twice = {one for one in names if names.count(one) > 1}
    ids = np.array([names.index(names[numbers[k]]) for k in kept]) if twice else None
    if mapping is not None and ids is None:  # a mended copy has no columns with names
        with suppress(DataFormatError):
            heads = [names[numbers[k]] for k in kept]
            own = channel_columns(heads, mapping, path)
            ids = np.array([own[one] for one in heads], np.int64)
    return replace(track, ids=ids, names=tuple(names) if twice else ())


def _named_columns(mapping: FileMapping | None) -> dict[str, str]:
    """Fields of columns of words, by their names and by the mapping of the file."""
    if mapping is None:
        return WORDS
    own = {"labels": mapping.label_column, "sessions": mapping.session_column,
           "people": mapping.person_column}  # fmt: skip
    return WORDS | {column.lower(): name for name, column in own.items() if column}


def tracks_of(recordings: Any, file: str = "recording", *, placed: bool = True) -> list[Track]:
    """Recordings of one or several parts as tables: parts that share all times are one table.

    Parameters
    ----------
    recordings : Recording or list of Recording
    file : str
        Name of it in findings; the part follows where there are several tables.
    placed : bool
        Whether places of the taxels are looked up.
    """
    several = list(recordings) if isinstance(recordings, list | tuple) else [recordings]
    if not several:
        raise DataFormatError("no recording in it", file)
    alike: dict[bytes, list[Any]] = {}
    for one in several:
        alike.setdefault(np.asarray(one.times, np.float64).tobytes(), []).append(one)
    many = len(alike) > 1
    return [
        _joined(own, ": ".join([file, *[", ".join(one.part for one in own)] * many]), placed)
        for own in alike.values()
    ]


def _joined(several: list[Any], file: str, placed: bool) -> Track:
    """Parts of the same times beside each other; a row is of a touch on any of them."""
    places = [_places_of(one.robot, one.part, one.pressures.shape[1]) for one in several if placed]
    known = [one for one in places if one is not None]
    events = np.full(len(several[0].times), -1)
    words: dict[str, list[str]] = {"labels": [], "sessions": [], "people": []}
    for one in several:
        own = np.asarray(one.events)
        free = (events < 0) & (own >= 0)
        events[free] = own[free] + len(words["labels"])
        for name, said in words.items():
            said += getattr(one, name) or [""] * len(one.labels)
    return Track(
        file,
        np.concatenate([one.pressures for one in several], axis=1),
        np.asarray(several[0].times),
        events=events,
        labels=tuple(words["labels"]),
        sessions=tuple(words["sessions"]) if any(words["sessions"]) else (),
        people=tuple(words["people"]) if any(words["people"]) else (),
        places=apart(known) if len(known) == len(several) else None,
        part=", ".join(one.part for one in several),
        robot=several[0].robot,
    )


def apart(places: list[FloatArray]) -> FloatArray:
    """Places of parts, each in a frame of its own, so far apart that none are neighbours."""
    return np.concatenate([one + np.array([FAR * k, 0.0, 0.0]) for k, one in enumerate(places)])


def placed(track: Track, robot: Robot) -> Track:
    """A track with the places of the first part of a robot, or of all, with as many channels.

    Raises
    ------
    SkinMismatchError
        None has as many.
    """
    width = track.values.shape[1]
    tables = {part: robot.repair(part).table for part in robot.parts}
    whole = list(tables.values())
    for several in [*([one] for one in whole), whole]:
        own = np.concatenate([one.positions for one in several])
        if len(own) == width:
            return replace(track, places=own)
        vectors = [int(one.channels.max()) + 1 for one in several]
        if width in (sum(vectors), sum(-(-one // 192) * 192 for one in vectors)) and (
            len(several) == 1 or sum(vectors) == width
        ):
            own = np.full((width, 3), np.nan)
            starts = np.cumsum([0, *vectors[:-1]])
            for start, one in zip(starts, several, strict=True):
                own[start + one.channels] = one.positions
            return replace(track, places=own)
    counts = ", ".join(f"{part} {len(one)}" for part, one in tables.items())
    raise SkinMismatchError(f"{track.file}: {width} channels; the taxels of {robot.name}: {counts}")


def _places_of(robot: str, part: str, width: int) -> FloatArray | None:
    """Places of a part's taxels where its robot is at hand."""
    if not robot:
        return None
    from skinmap.io.robots.manifest import load_robot

    try:
        places = load_robot(robot).skin(part).positions
    except SkinError:
        return None
    return np.asarray(places, np.float64) if len(places) == width else None


def _from_stream(path: Path) -> Track:
    from skinmap.io.robots.manifest import builtin_named
    from skinmap.live.sources.open_source import open_track

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = open_track(path)
    blocks = [np.asarray(values) for _, values in found.blocks()]
    if not blocks:
        raise DataFormatError("no samples", path)
    values = np.concatenate(blocks)
    events = np.full(len(values), -1)
    for number, touch in enumerate(found.touches):
        events[max(touch.first, 0) : touch.last + 1] = number
    places = []
    for part, width in zip(found.info.parts, found.info.widths, strict=True):
        table, own = found.tables.get(part), np.full((width, 3), np.nan)
        if table is not None and len(table.positions) == width:
            own = np.asarray(table.positions, np.float64)
        elif table is not None and int(table.channels.max(initial=-1)) < width:
            own[table.channels] = table.positions
        places.append(own)
    whole = apart(places)
    known = bool(found.tables) and np.isfinite(whole).any()
    robot = found.manifest or builtin_named(found.info.robot) or ""
    robot = robot if found.kind == "pressure" else ""
    return Track(
        str(path), values, np.asarray(found.times), events=events,
        labels=tuple(one.label for one in found.touches),
        sessions=tuple(one.session for one in found.touches),
        people=tuple(one.person for one in found.touches),
        places=whole if known else None,
        part=", ".join(found.info.parts) if robot else "",
        robot=robot,
    )  # fmt: skip


def tables_in(path: Path) -> list[Track]:
    """The tables of a recording: one, or one for each part that has times of its own."""
    from skinmap.io.recordings.touch_files import load_recordings, part_logs

    if is_own_archive(path):
        return [check_track(one) for one in tracks_of(load_recordings(path), str(path))]
    logs = part_logs(path)
    if not logs:
        return [read_track(path)]
    several = len(logs) > 1
    # A part of one channel has none to be compared with.
    wide = {part: one for part, one in logs.items() if one[1].shape[1] > 1} or logs
    return [
        check_track(
            Track(": ".join([str(path), *[part] * several]), values, times, part=part * several)
        )
        for part, (times, values, _) in wide.items()
    ]


def tracks(paths: list[Path]) -> Iterator[Track]:
    """The tables of the recordings that paths name, each once."""
    for path in dict.fromkeys(one for given in paths for one in files_of(given)):
        yield from tables_in(path)
