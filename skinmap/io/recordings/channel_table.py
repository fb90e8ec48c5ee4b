"""Channels over time in tables: CSV with a header or a mapping file, plain NPZ, CySkin's text."""

from __future__ import annotations

import csv
import re
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from skinmap.archive import open_arrays
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, warn
from skinmap.io.recordings.touch_files import Mapping, needed_mapping
from skinmap.io.robots.manifest import load_robot
from skinmap.io.text import DECIMAL_COMMA, MAX_CHANNEL, check_file, in_file
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin
from skinmap.summary import first_few
from skinmap.touch.contacts.skin_geometry import ACTIVE
from skinmap.touch.recording import Recording, check_label

Numbered = Literal["channel", "id", "count"]
MAX_BYTES = 2**30  # a table is read whole
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
THOUSANDS = re.compile(r"[+-]?\d{1,3}(,\d{3})+")
NUMBER = re.compile(r"\D*([0-9]+)")  # ch12, taxel_12, 12
MAX_SECONDS = 2.0**34  # as recordings of ours hold at most
APART = 1.0  # seconds between stretches whose times begin anew
COUNTS = 255.0
DIGITS = 18  # of a number that a channel may have before it is refused as too large
FEW = 5  # names in a message
LOOKED_AT = 2000  # samples that the rest of a skin is judged by
LOWEST = 2.0  # percentile of the samples: a skin that is pressed for long is let go at times
SLOW = 2.0  # step between samples from which times are hardly seconds [s]


@dataclass(frozen=True, eq=False, slots=True)
class ChannelTable:
    """Values of channels over time, as a file has them.

    Attributes
    ----------
    times : (t,) float
        [s].
    values : (t, c) float
    channels : (c,) int
        Channel of the skin's live vector, or id of the taxel.
    events : (t,) int
        Stretch or touch of each sample; -1 between touches.
    labels, sessions, people : tuple of str
        Of each event.
    stretches : (t,) int, optional
        Files that were joined: each has a rest, and times, of its own.
    numbered : {"channel", "id", "count"}
        By which `channels` number the taxels: places in the live vector, ids of the hardware, or
        only as the columns are counted.
    """

    times: FloatArray
    values: FloatArray
    channels: IntArray
    events: IntArray
    labels: tuple[str, ...]
    sessions: tuple[str, ...] = ()
    people: tuple[str, ...] = ()
    stretches: IntArray | None = None
    numbered: Numbered = "channel"


def recording_of(table: ChannelTable, mapping: Mapping, path: Path) -> Recording:
    """Pressures of the skin that a mapping names.

    Channels without a taxel are left out, taxels without a channel rest at zero; both are told.

    Raises
    ------
    DataFormatError
        Times that run backwards, values that are not numbers, channels given twice, or none that
        the skin has.
    """
    robot = load_robot(mapping.robot)
    skin = robot.skin(mapping.part)
    _check(table, path)
    with in_file(path):
        labels = tuple(check_label(label) for label in table.labels)
    with np.errstate(over="ignore", invalid="ignore"):  # what is too large is a pressure of 255
        values = np.where(mapping.falling, -1.0, 1.0) * table.values
        if mapping.rest_percentile is not None:
            values = _above_rest(values, table.stretches, mapping.rest_percentile)
        counts = values * (COUNTS / mapping.full_scale)
        _check_scale(counts, mapping, path)
        np.rint(np.clip(counts, 0.0, COUNTS, out=counts), out=counts)  # may be a gigabyte
    np.nan_to_num(counts, copy=False, nan=0.0)
    pressures = np.zeros((len(counts), len(skin)), np.uint8)
    rows, columns = _places(_numbers_of(robot, skin, table), table.channels, path)
    pressures[:, rows] = counts[:, columns]
    return Recording(
        mapping.part,
        _follow_on(table.times, table.stretches),
        pressures,
        table.events,
        labels,
        robot=mapping.robot,
        sessions=table.sessions or (mapping.session,) * len(labels),
        people=table.people or (mapping.person,) * len(labels),
    )


def _check_scale(counts: FloatArray, mapping: Mapping, path: Path) -> None:
    """Warn where a mapping makes nothing of pressures, or all of them the largest."""
    low, high = (float(end(counts, initial=0.0)) for end in (np.nanmin, np.nanmax))
    as_counted = mapping.full_scale == COUNTS and mapping.rest_percentile is None
    some = counts[:: max(1, len(counts) // LOOKED_AT)]
    rest = float(np.median(np.percentile(some, LOWEST, axis=0))) if some.size else 0.0
    if low < 0.0 == high:
        wrong = "no pressure lies above 0"
    elif as_counted and 0.0 < high <= 1.0 and bool((counts % 1.0).any()):
        wrong = f"the largest pressure is {high:.2g} of 255 counts"
    elif as_counted and high > 2.0 * COUNTS:
        wrong = f"values reach {high:.4g}, and 255 counts are the most"
    elif mapping.rest_percentile is None and rest > ACTIVE:
        wrong = f"it never reads less than {rest:.0f} counts, as if all of it were touched"
    else:
        return
    warn(f"{path.name}: {wrong}; see rest_percentile, full_scale and falling of its mapping")


def _check(table: ChannelTable, path: Path) -> None:
    if not np.isfinite(table.values).all():
        row, column = np.argwhere(~np.isfinite(table.values))[0]
        raise DataFormatError(
            f"sample {row} holds no number at channel {table.channels[column]}", path
        )
    stretches = np.zeros(len(table.times)) if table.stretches is None else table.stretches
    strange = (table.channels < 0) | (table.channels > MAX_CHANNEL)
    if strange.any():
        raise DataFormatError(f"{table.channels[strange][0]} is not a channel number", path)
    back = (np.diff(table.times) < 0) & (np.diff(stretches) == 0)
    if not (np.abs(table.times) < MAX_SECONDS).all():
        raise DataFormatError("holds times that are not seconds of this age", path)
    if back.any():
        row = int(np.flatnonzero(back)[0]) + 1
        raise DataFormatError(
            f"samples are out of order: sample {row} at {table.times[row]:.13g} s comes after "
            f"{table.times[max(row - 1, 0)]:.13g} s",
            path,
        )
    step = float(np.median(np.diff(table.times))) if len(table.times) > 1 else 0.0
    if step >= SLOW:
        warn(f"{path.name}: a sample every {step:.4g} s; see time_unit of its mapping", above=1)
    twice = [number for number, count in Counter(table.channels.tolist()).items() if count > 1]
    if twice:
        raise DataFormatError(f"channels given twice: {', '.join(map(str, twice[:FEW]))}", path)


def _above_rest(values: FloatArray, stretches: IntArray | None, calm: float) -> FloatArray:
    """Values above what each channel reads at rest, of each joined file its own."""
    found = np.empty_like(values)
    numbers = np.zeros(len(values)) if stretches is None else stretches
    for number in np.unique(numbers):
        rows = numbers == number
        found[rows] = values[rows] - np.percentile(values[rows], calm, axis=0)
    return found


def _numbers_of(robot: Robot, skin: Skin, given: ChannelTable) -> IntArray:
    """(n,) number of each taxel: its channel, its id (-1 for none), or its place in the table."""
    if given.numbered == "count" and len(given.channels) == len(skin):
        return np.arange(len(skin))  # they hold the taxels alone, in the order of their channels
    table = robot.part(skin.part).read()
    if not len(table.ids):
        return skin.channels
    place = dict(zip(table.channels.tolist(), table.ids.tolist(), strict=True))
    ids = np.array([place[channel] for channel in skin.channels.tolist()], np.int64)
    by_channel, by_id = (int(np.isin(given.channels, one).sum()) for one in (skin.channels, ids))
    return skin.channels if given.numbered != "id" and by_channel >= max(by_id, 1) else ids


def _places(numbers: IntArray, channels: IntArray, path: Path) -> tuple[IntArray, IntArray]:
    """Rows of the skin's taxels and columns of the table that belong together."""
    column = {int(channel): k for k, channel in enumerate(channels)}
    found = np.array([column.get(number, -1) for number in numbers.tolist()])
    rows = np.flatnonzero(found >= 0)
    if len(rows) == 0:
        raise DataFormatError(
            f"none of its {len(channels)} channels ({channels.min()} to {channels.max()}) is one "
            f"of the skin's ({numbers.min()} to {numbers.max()}): another skin",
            path,
        )
    idle, lost = len(numbers) - len(rows), len(channels) - len(rows)
    if idle or lost:
        shifted = channels.min() == 1 and numbers.min() == 0 and len(channels) == len(numbers)
        cause = "; its channels may count from 1: name them from 0 in `channels`" if shifted else ""
        warn(
            f"{path.name}: {lost} channels without a place were left out, {idle} places without "
            f"a channel rest at zero{cause}"
        )
    return rows, found[rows]


def _follow_on(times: FloatArray, stretches: IntArray | None) -> FloatArray:
    """Times that do not run backwards: each stretch begins a second after the one before."""
    if stretches is None:
        return times
    found = np.array(times, np.float64)
    for row in np.flatnonzero(np.diff(stretches)) + 1:
        found[row:] += found[row - 1] + APART - found[row]
    return found


def read_table(path: Path) -> list[Recording]:
    """Read a CSV of channels over time.

    A header names the columns: the time, channels by a number in their name, and those that the
    mapping calls label, event, person or session. Lines that begin with `#` are left aside.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, no mapping, or a table that does not follow it.
    """
    check_file(path, "a table of channels over time", MAX_BYTES)
    mapping = needed_mapping(path)
    rows = text_rows(path, mapping.columns)
    _, names = next(rows)
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise DataFormatError(f"columns given twice: {first_few(twice, FEW)}", path)
    words = (mapping.label_column, mapping.person_column, mapping.session_column)
    others = {mapping.time, mapping.event_column, *words}
    channels = channel_columns([name for name in names if name not in others], mapping, path)
    place = {name: k for k, name in enumerate(names)}
    for name in (*words, mapping.event_column, None if mapping.rate_hz else mapping.time):
        if name is not None and name not in place:
            raise DataFormatError(
                f"no column {name!r}; the columns are: {first_few(names, FEW)}", path
            )
    beside = [name for name in (mapping.time, mapping.event_column) if name in place]
    columns = [place[name] for name in (*channels, *beside) if name is not None]
    table, said = table_columns(rows, names, columns, [place[one] for one in words if one], path)
    if not len(table):
        raise DataFormatError("no samples", path)
    held: dict[str, NDArray[Any]] = {"values": table[:, : len(channels)]}
    held["channels"] = np.array(list(channels.values()), np.int64)
    if mapping.time in place:
        held["times"] = table[:, len(channels)]
    numbers = None
    if mapping.event_column is not None:
        numbers = whole_numbers(table[:, -1], mapping.event_column, len(table), path)
    told, people, sessions = (said[place[one]] if one else None for one in words)
    held["events"], first = _events(told, numbers, mapping.label_of(path), len(table))
    for name, own in (("labels", told), ("people", people), ("sessions", sessions)):
        if own is not None:
            held[name] = np.array([own[row] for row in first], np.str_)
    return [recording_of(_table_of(held, mapping, path), mapping, path)]


def text_rows(
    path: Path, columns: Sequence[str] = (), *, thousands: bool = True
) -> Iterator[tuple[int, list[str]]]:
    """Names of the columns of a table, then line and words of each row.

    Lines that begin with `#` are left aside. Beside `;`, tabs and blanks a comma is a decimal one.

    Parameters
    ----------
    path : Path
    columns : sequence of str
        Names of a table without a header.
    thousands : bool
        Whether commas that may part thousands are taken for decimal ones.

    Raises
    ------
    DataFormatError
        Not a table, a row of another length, or thousands.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = (
                "" if line.startswith("#") or not line.strip() else line.strip(" \r\n")
                for line in file
            )
            before, head = next(((k, line) for k, line in enumerate(lines) if line), (0, ""))
            # A comma comes late: beside another sign it may be that of a number.
            signs = (one for one in (";", "\t", ",", " ") if one in head.replace(",\t", ","))
            delimiter = next(signs, ",")
            reader = csv.reader(chain([head], lines), delimiter=delimiter, skipinitialspace=True)
            names = list(columns) or [cell.strip() for cell in next(reader)]
            yield before + 1, names
            table = ((before + reader.line_num, row) for row in reader if row)
            begin = [] if thousands or delimiter == "," else list(islice(table, LOOKED_AT))
            _refuse_thousands(begin, path)
            for number, (line, row) in enumerate(chain(begin, table)):
                if len(row) != len(names):
                    raise DataFormatError(
                        f"sample {number} has {len(row)} values for {len(names)} columns", path
                    )
                if delimiter != "," and any("," in cell for cell in row):
                    row = [DECIMAL_COMMA.sub(r"\1.\2", cell) for cell in row]
                yield line, row
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataFormatError(f"not a table: {error}", path) from None


def _refuse_thousands(rows: Iterable[tuple[int, list[str]]], path: Path) -> None:
    cells = [cell.strip() for _, row in rows for cell in row]
    parted = [cell for cell in cells if "," in cell]
    whole = any(cell.isdigit() and len(cell) > 2 for cell in cells)
    if parted and whole and all(THOUSANDS.fullmatch(cell) for cell in parted):
        raise DataFormatError(
            f"{parted[0]!r} has a decimal comma or parted thousands: write it without", path
        )


def table_columns(
    rows: Iterable[tuple[int, list[str]]],
    names: Sequence[str],
    numbers: Sequence[int],
    words: Sequence[int],
    path: Path,
    *,
    gaps: bool = False,
) -> tuple[FloatArray, dict[int, list[str]]]:
    """Numbers (t, n) of some columns of `text_rows`, and words of others by their place.

    With `gaps` an empty cell is NaN, else DataFormatError as any other word.
    """
    held, count = array("d"), 0  # a word takes ten times the memory of its number
    said: dict[int, list[str]] = {k: [] for k in words}
    known: dict[str, str] = {}
    for count, (line, row) in enumerate(rows, 1):
        try:
            held.extend([float(row[k]) for k in numbers])
        except ValueError:
            cells = {k: row[k].strip() or "nan" * gaps for k in numbers}
            for k, cell in cells.items():
                if not is_number(cell):
                    raise DataFormatError(
                        f"sample {count - 1} holds {row[k]!r}, no number, in column {names[k]!r} "
                        f"(line {line})",
                        path,
                    ) from None
            held.extend(map(float, cells.values()))
        for k, told in said.items():
            word = row[k].strip()
            told.append(known.setdefault(word, word))
    return np.frombuffer(held).reshape(count, len(numbers)), said


def is_number(word: str) -> bool:
    """Whether Python takes a word for a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def channel_columns(names: Sequence[str], mapping: Mapping, path: Path) -> dict[str, int]:
    """Channel of each column that is one."""
    if mapping.channels:
        missing = [name for name in mapping.channels if name not in names]
        if missing:
            raise DataFormatError(
                f"no columns {first_few(missing, FEW)}; the columns are: {first_few(names, FEW)}",
                path,
            )
        return dict(mapping.channels)
    found = {name: NUMBER.fullmatch(name) for name in names}
    strange = [name for name, match in found.items() if match is None]
    if strange or not found:
        raise DataFormatError(
            f"columns without a channel's number: {first_few(strange, FEW) or 'none at all'}; name "
            "them in the mapping (time, label_column, channels ...)",
            path,
        )
    return {name: int(match[1][:DIGITS]) for name, match in found.items() if match is not None}


def _events(
    labels: list[str] | None, numbers: IntArray | None, label: str, count: int
) -> tuple[IntArray, list[int]]:
    """Event of each sample, and the first sample of each event.

    Events are numbered, or run as long as a label stays the same; an empty label is no touch.
    """
    if numbers is None and labels is None:
        return (np.zeros(count, np.int64), [0]) if label else (np.full(count, -1), [])
    words = np.array(labels or [])
    touched = np.ones(count, bool) if labels is None else words != ""
    if numbers is not None:
        touched = touched & (numbers >= 0)
    keys = words if numbers is None else numbers
    begins = touched & np.append(True, (keys[1:] != keys[:-1]) | ~touched[:-1])
    return np.where(touched, np.cumsum(begins) - 1, -1), np.flatnonzero(begins).tolist()


def read_arrays(path: Path) -> list[Recording]:
    """Read a plain NPZ: `values` (t, c) and `times` (t,) with a mapping beside it.

    `channels` (c,), or `taxel_ids`, says which channels they are, 0 to c - 1 by default, or the
    c taxels alone in the order of their channels; `events`
    (t,), or `file_index`, which touch or file each sample is of; `labels` (k,), or `file_class`,
    what each was called; `sessions` and `people` (k,) in words.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, no mapping, or arrays that do not fit together.
    """
    check_file(path, "an NPZ of channels over time", MAX_BYTES)
    mapping = needed_mapping(path)
    with open_arrays(path, "an NPZ of channels over time") as arrays:
        found = {name: np.asarray(arrays[name]) for name in ARRAYS if name in arrays}
        return [recording_of(_table_of(found, mapping, path), mapping, path)]


ARRAYS = (
    "values", "samples", "times", "channels", "taxel_ids", "events", "file_index", "labels",
    "file_class", "sessions", "people", "mended",
)  # fmt: skip


def _table_of(arrays: dict[str, NDArray[Any]], mapping: Mapping, path: Path) -> ChannelTable:
    values = first_of(arrays, ("values", "samples"))
    if values is None or values.ndim != 2 or values.dtype.kind not in "uif":
        raise DataFormatError("no table of numbers `values` or `samples`, one row a sample", path)
    count, width = values.shape
    if "times" in arrays:
        unit = None if "mended" in arrays else mapping.time_unit  # a mended copy is in seconds
        times = np.asarray(arrays["times"], np.float64) * SECONDS[unit or "s"]
    elif mapping.rate_hz is not None:
        times = np.arange(count) / mapping.rate_hz
    else:
        raise DataFormatError("no `times` (t,): name them, or give rate_hz in its mapping", path)
    if times.shape != (count,):
        raise DataFormatError(f"times of shape {times.shape}, expected ({count},)", path)
    channels = whole_numbers(first_of(arrays, ("channels", "taxel_ids")), "channels", width, path)
    numbered: Numbered = "id" if "taxel_ids" in arrays else "count"
    label = mapping.label_of(path)
    stretches = whole_numbers(arrays.get("file_index"), "file_index", count, path)
    events = whole_numbers(arrays.get("events"), "events", count, path)
    if events is None:
        events = np.full(count, 0 if label else -1) if stretches is None else stretches
    kinds = min(int(np.max(events, initial=-1)) + 1, count)
    labels = words_of(first_of(arrays, ("labels", "file_class"))) or (label,) * kinds
    if len(labels) < kinds:
        raise DataFormatError(f"{len(labels)} labels for {kinds} events", path)
    return ChannelTable(
        times,
        values.astype(np.float64),
        np.arange(width) if channels is None else channels,
        events,
        labels,
        words_of(arrays.get("sessions")),
        words_of(arrays.get("people")),
        stretches,
        "channel" if "channels" in arrays else numbered,
    )


def first_of(held: dict[str, NDArray[Any]], names: Sequence[str]) -> NDArray[Any] | None:
    """The first array that is there of some names."""
    return next((held[one] for one in names if one in held), None)


def words_of(found: NDArray[Any] | None) -> tuple[str, ...]:
    """The items of an array as words; none without it."""
    return () if found is None else tuple(str(one).strip() for one in found.ravel().tolist())


def whole_numbers(found: NDArray[Any] | None, name: str, count: int, path: Path) -> IntArray | None:
    """An array (count,) of whole numbers; None without it.

    Raises
    ------
    DataFormatError
        Another shape or type, or fractions.
    """
    if found is None:
        return None
    if found.shape != (count,) or found.dtype.kind not in "buif":
        raise DataFormatError(f"{name} of shape {found.shape}; ({count},) expected", path)
    if found.dtype.kind == "f" and not ((found == np.rint(found)) & (abs(found) < 2**53)).all():
        raise DataFormatError(f"{name} holds fractions; whole numbers expected", path)
    return found.astype(np.int64)


ERROR = 43_000  # values from here on are a sensor's error codes
LEAD = 2  # number and time before the values of a line


def read_cyskin_text(path: Path) -> list[Recording]:
    """Read what CySkin's own programs write, with a mapping that names its skin.

    One sample a line, in either of two forms:

    1. The first line holds the ids of all channels; each further line a number, the time [s] and a
       value a channel.
    2. No such line: each line holds a number and the time [s], then an id and its value in turn.

    Values fall into 0 to 20,002; more is an error of a sensor, read as nothing.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, no mapping, or lines that do not fit together (named).
    """
    check_file(path, "a CySkin recording", MAX_BYTES)
    mapping = needed_mapping(path)
    try:
        with path.open(encoding="utf-8") as file:
            lines = (line for line in file if line.strip() and not line.startswith("#"))
            begin = list(islice(lines, 2))
            if len(begin) < 2:
                raise DataFormatError("no samples", path)
            ids, sample = (line.split() for line in begin)
            heads = all(word.isascii() and word.isdigit() for word in ids)
            heads = heads and len(sample) == len(ids) + LEAD
            rows = np.loadtxt(chain(begin[heads:], lines), comments=None, ndmin=2)
    except UnicodeDecodeError as error:
        raise DataFormatError(f"not a text file ({error.reason})", path) from None
    except ValueError as error:
        if isinstance(error, DataFormatError):
            raise
        raise DataFormatError(f"not a CySkin recording: {error}", path) from None
    if heads:
        channels = [min(int(word[:DIGITS]), MAX_CHANNEL + 1) for word in ids]
        values = rows[:, LEAD:]
    else:
        pairs = rows[:, LEAD:]
        if pairs.shape[1] == 0 or pairs.shape[1] % 2 or (pairs[:, ::2] != pairs[0, ::2]).any():
            raise DataFormatError(
                "neither a line of ids and then samples, nor samples of ids and values in turn",
                path,
            )
        if not ((pairs[0, ::2] >= 0) & (pairs[0, ::2] <= MAX_CHANNEL)).all():
            raise DataFormatError("ids that are not numbers of taxels", path)
        channels, values = pairs[0, ::2].astype(np.int64).tolist(), pairs[:, 1::2]
    held = {
        "values": np.where(values >= ERROR, 0.0, values),
        "times": rows[:, 1],
        "taxel_ids": np.array(channels, np.int64),
    }
    return [recording_of(_table_of(held, mapping, path), mapping, path)]
