"""What YARP's data dumper wrote: `data.log`, a line a sample: number, time stamp, values.

The skin of an iCub sends one live vector a part, 0 to 255 and lower where pressed harder; the
values are given as they are. A folder may hold one folder a part, each with its `data.log`.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, MissingFileError, UnknownNameError, warn
from skinmap.io.recordings.recorded_stream import (
    Kind,
    Loss,
    RecordedStream,
    StreamInfo,
    measured_rate,
)
from skinmap.io.text import check_file
from skinmap.skin.robot import Robot

FILE = "data.log"
MAX_BYTES = 8 * 2**30
MAX_LINE = 8 * 2**20  # a line of a million values
BLOCK = 1024  # lines kept as numbers before they are packed
RANGE = (0.0, 255.0)
LATE = 10  # samples on end that may come late; more are those of a clock that began anew
HELD = 3.5  # usual periods of a part for which its last sample stands
APART = 1.0  # seconds by which parts of one recording may begin and end after each other
BURST = 0.5  # seconds between bursts at most; longer ones are pauses
ODD = 3  # steps of a part, the longest, that may be gaps
USUAL = 95.0  # percentile of the steps of a part that is its usual period


PartLog = tuple[FloatArray, NDArray[Any], str]  # times, values, and what was wrong with its end


def read_dump(path: Path, *, robot: Robot | None = None) -> RecordedStream:
    """Read one `data.log`, or a folder with one for each part.

    Parameters
    ----------
    path : Path
        A log, its folder, or a folder of such folders. Parts are called as their folders.
    robot : Robot, optional
        A folder whose name holds that of one of its parts ("skin_left_arm") is that part.

    Returns
    -------
    RecordedStream
        Raw values. Several parts are given at the times of the one with most samples, each with
        what it last sent, as far as all of them were recorded.

    Raises
    ------
    MissingFileError, DataFormatError
        No log, or one that does not follow its format (names the line).
    UnknownNameError
        A folder that is called like no part of the robot.
    """
    name = path.name if path.is_dir() else path.parent.name or path.name
    read = read_logs(path, robot=robot)
    return side_by_side(name, read, "raw", "" if robot is None else robot.name, path)


def read_logs(path: Path, *, robot: Robot | None = None) -> dict[str, PartLog]:
    """The log of each part, in the order of its lines; arguments and errors as `read_dump`."""
    logs = _logs(path)
    named = {_part(log, robot): log for log in logs}
    if len(named) < len(logs):
        raise DataFormatError("two logs of one part", path)
    return {part: read_log(log) for part, log in named.items()}


def _logs(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    if (path / FILE).exists():
        return [path / FILE]
    logs = sorted(path.glob(f"*/{FILE}"))
    if not logs:
        raise MissingFileError(path / FILE, f"{FILE} here or in a folder a part")
    return logs


def _part(log: Path, robot: Robot | None) -> str:
    name = log.resolve().parent.name
    if robot is None:
        return name
    fitting = [part for part in robot.parts if part in name]
    if not fitting:
        if len(robot.parts) == 1:
            return robot.parts[0]
        raise UnknownNameError(f"part of {robot.name} for the folder", name, robot.parts)
    return max(fitting, key=len)


def read_log(path: Path) -> PartLog:
    """Times (t,) [s] and values (t, channels) of one log, and what was wrong with its end.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or an invalid line (named): only the last may be cut off.
    """
    check_file(path, "a log of the data dumper", MAX_BYTES)
    times: list[float] = []
    done: list[NDArray[Any]] = []
    rows: list[NDArray[np.float64]] = []
    number, width, damage = 0, 0, ""
    with path.open("rb") as file:
        while line := file.readline(MAX_LINE + 1):
            number += 1
            if len(line) > MAX_LINE:
                raise DataFormatError(f"a line above {MAX_LINE} bytes", path, number)
            if not line.strip():
                continue
            row = _numbers(line)
            whole = line.endswith(b"\n")
            fits = row is not None and len(row) >= 3 and len(row) == (width or len(row))
            if not whole and (fits or width):  # its last number may have lost digits
                damage = f"cut off in line {number}"
                break
            if row is None or not fits:
                raise DataFormatError(_what(row, width), path, number)
            _check(row, path, number)
            width = len(row)
            times.append(float(row[1]))
            rows.append(row[2:])
            if len(rows) == BLOCK:
                done.append(_packed(rows))
                rows = []
    if rows:
        done.append(_packed(rows))
    if not times:
        raise DataFormatError("no sample in it", path)
    return np.array(times), np.concatenate(done), damage


def _numbers(line: bytes) -> NDArray[np.float64] | None:
    if b"_" in line:  # only Python would call that a number
        return None
    try:
        return np.array(line.split(), np.float64)
    except ValueError:
        return None


def _what(row: NDArray[np.float64] | None, width: int) -> str:
    if row is None:
        return "expected numbers only: sequence number, time stamp, values"
    if width:
        return f"{len(row) - 2} values, the lines before it have {width - 2}"
    return f"expected a sequence number, a time stamp and values, got {len(row)} numbers"


def _check(row: NDArray[np.float64], path: Path, line: int) -> None:
    if not np.isfinite(row).all():
        raise DataFormatError("expected finite numbers", path, line)
    values = row[2:]
    low, high = float(values.min()), float(values.max())
    if low < RANGE[0] or high > RANGE[1]:
        worst = low if low < RANGE[0] else high
        raise DataFormatError(f"a value of {worst:g}; a taxel sends 0 to 255", path, line)


def _packed(rows: list[NDArray[np.float64]]) -> NDArray[Any]:
    """Rows in a byte a value where they are whole, else in four."""
    values = np.array(rows)
    return values.astype(np.uint8 if (values == np.floor(values)).all() else np.float32)


def side_by_side(
    name: str, read: dict[str, PartLog], kind: Kind, robot: str, path: Path
) -> RecordedStream:
    """All parts at the times of the one with most samples, each holding what it sent last."""
    start = max(times.min() for times, _, _ in read.values())
    end = min(times.max() for times, _, _ in read.values())
    shared, columns = at_shared_times(read, path, start, end)
    rate = measured_rate(shared)
    info = StreamInfo(name, tuple(read), tuple(one.shape[1] for one in columns), rate, kind, robot)
    cut = tuple(damage for _, _, damage in read.values() if damage)
    loss = Loss(True, 1.0 / rate if rate else 0.0, cut) if cut else Loss()
    return RecordedStream(info, shared, np.concatenate(columns, axis=1), loss=loss)


def at_shared_times(
    read: Mapping[str, PartLog],
    path: Path,
    start: float = -np.inf,
    end: float = np.inf,
    *,
    kept: Container[str] = (),
) -> tuple[FloatArray, list[NDArray[Any]]]:
    """Times (t,) of the part with most samples [s], and the values (t, channels) of each at them.

    Samples that came late are put where their time stamp stands. Times at which a part had been
    silent for longer than a few of its periods are left out, and named in a warning.

    Parameters
    ----------
    read : mapping of str to PartLog
    path : Path
    start, end : float
        Between which times [s].
    kept : container of str
        Parts that send when they like: what they sent last stands until the next.

    Raises
    ------
    DataFormatError
        A clock that began anew, or parts that were recorded at other times.
    """
    ordered = {part: _ordered(part, one[0], one[1], path) for part, one in read.items()}
    reference = max((times for times, _ in ordered.values()), key=len)
    known = (reference >= start) & (reference <= end)
    held = {part: _held_rows(times, reference) for part, (times, _) in ordered.items()}
    silences = {part: silent for part, (_, silent) in held.items() if part not in kept}
    known &= ~np.any(list(silences.values()), axis=0) if silences else True
    if not known.any():
        raise DataFormatError("its parts were recorded at other times", path)
    for part, silent in silences.items():
        first, last = ordered[part][0][[0, -1]]
        inside = (reference > first) & (reference < last)
        if (silent & (inside | (reference < first - APART) | (reference > last + APART))).any():
            since = reference[np.flatnonzero(silent)[0]] - reference[0]
            warn(
                f"{path.name}: {part!r} sent nothing at {silent.sum()} of {len(silent)} samples, "
                f"first {since:.2f} s from the beginning; they are left out of all parts",
                above=2,
            )
    return reference[known], [ordered[part][1][rows[known]] for part, (rows, _) in held.items()]


def _ordered(
    part: str, times: FloatArray, values: NDArray[Any], path: Path
) -> tuple[FloatArray, NDArray[Any]]:
    """Samples in the order of their times; a clock that began anew leaves them none."""
    behind = times < np.maximum.accumulate(times)
    ahead = times > np.minimum.accumulate(times[::-1])[::-1]
    late, early = (_longest_run(one) for one in (behind, ahead))
    if min(len(late), len(early)) > LATE:  # few samples ahead are stamps that are wrong alone
        row = int(late[0])
        raise DataFormatError(
            f"the clock of {part!r} began anew: sample {row} is "
            f"{times[:row].max() - times[row]:.4g} s earlier than one before it",
            path,
        )
    order = np.argsort(times, kind="stable")
    return times[order], values[order]


def _held_rows(times: FloatArray, at: FloatArray) -> tuple[IntArray, NDArray[np.bool_]]:
    """Rows (k,) of a part that stand at times (k,), and whether it was silent there for long.

    Samples of one time stand one after the other, so that none hides the others.
    """
    first, behind = (np.searchsorted(times, at, side=side) for side in ("left", "right"))
    to_come = np.searchsorted(at, at, side="right") - np.arange(len(at))  # of this time, with it
    rows = np.where(behind > first, np.maximum(first, behind - to_come), behind - 1).clip(0)
    return rows, np.abs(at - times[rows]) > HELD * _usual_step(np.diff(times))


def _longest_run(chosen: NDArray[np.bool_]) -> IntArray:
    """Rows of the longest run of chosen ones."""
    rows = np.flatnonzero(chosen)
    return max(np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1), key=len)


def _usual_step(steps: FloatArray) -> float:
    """Usual time between two samples [s]; of bursts the time between them."""
    steps = np.sort(steps[steps > 0])
    if not len(steps):
        return np.inf
    passed = np.cumsum(steps[: max(len(steps) - ODD, 1)])
    most = steps[np.searchsorted(passed, 0.5 * passed[-1])]
    usual = float(np.percentile(steps, USUAL))
    return max(usual, float(most)) if most <= BURST else usual
