"""Samples of a skin beside a known load, each on its own clock: `.npz`, `.csv` or `.mcap`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from skinmap.archive import read_arrays
from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite
from skinmap.errors import DataFormatError, InvalidArrayError, MessageError
from skinmap.io.mcap.reading import Content, Index, Messages, read_track
from skinmap.io.mcap.writing import METADATA
from skinmap.io.recordings.channel_table import table_columns, text_rows
from skinmap.io.ros2.messages import nanoseconds_of, read
from skinmap.io.text import check_file, in_file
from skinmap.touch.load_calibration import rate_of_times

PRESSURES = {"pressure_bar": 1.0, "pressure_kpa": 1e-2, "pressure_pa": 1e-5}
FORCES = {"mass_kg": 9.80665, "stand": 9.80665, "force_n": 1.0}
THERMAL = "temperature_channel"  # of each channel's module, -1 for none
PRINTS = "prints"  # areas [mm2] of touches, for areas instead of pressures
WRENCH = "wrench"  # force [N] and moment [N m] of a sensor behind the skin, in the link's frame
UNITS = {"psi": "bar = psi x 0.0689476", "mmhg": "bar = mmHg x 0.00133322"}
BAR = 1e-5  # bar in a pascal
NUMBERS = ("UInt8", "Int16", "UInt16", "Int32", "UInt32", "Float32", "Float64")
ARRAYS = {f"std_msgs/{number}MultiArray" for number in NUMBERS}  # messages of samples
ABSOLUTE = 5e4  # [Pa]: a pressure that never falls below it is not one above the atmosphere's
MAX_BAR = 20.0  # above it the unit is wrong: foams of skins are flat by then
MIN_BAR = 5e-4  # below it, too: a hundredth of a finger's touch
LEAST_RATE, MOST_RATE = 1.0, 1e4  # samples a second: beyond them times are in another unit
LEAST_SECONDS = 0.5  # of samples beside a load: rest and a press take longer
LATE = 1.0  # that rows may come late, in a burst [s]
GAP, LOST = 1.7, 5  # steps between rows that lost some, and lost rows that lay the others apart
FAR = 2.0  # rows from the next sample at which a row has none
MOST_APART = 4  # rows for each sample: of longer pauses the rows stay as they are


@dataclass(frozen=True, eq=False, slots=True)
class LoadEvidence:
    """Evidence of one recording for a load calibration.

    Attributes
    ----------
    name : str
        Of its file.
    samples : (t, n) array
        Raw counts.
    times : (t,) float
        [s].
    kind : str
        Name of the reference; empty without any.
    reference : (u,) float
        [bar], or [N] for masses and forces; none without any. A wrench is (u, 6) [N, N m].
    reference_times : (u,) float or None
        [s]; None where the nominal rate is that of the samples.
    channels : (k,) int or None
        Which channels felt it; None for all.
    events : (t,) int or None
        Of prints: the touch of each row, -1 for none. Their reference is (k,), one a touch [mm2].
    thermal : (n,) int or None
        Channel with the temperature of each channel's module, -1 for none.
    """

    name: str
    samples: NDArray[Any]
    times: FloatArray
    kind: str = ""
    reference: FloatArray = field(default_factory=lambda: np.zeros(0))
    reference_times: FloatArray | None = None
    channels: IntArray | None = None
    events: IntArray | None = None
    thermal: IntArray | None = None

    @property
    def rate(self) -> float:
        """Samples a second."""
        return rate_of_times(self.times, len(self.times)) or 0.0

    def on_even_rows(self) -> EvenRows:
        """The samples at a steady rate, where their times show lost rows or another rate."""
        count = np.arange(len(self.times))
        steps = np.diff(self.times[:: max(1, round(self.rate))]) / max(1, round(self.rate))
        rate = 1.0 / max(float(np.quantile(steps, 0.1)), 1.0 / MOST_RATE) if len(steps) else 0.0
        ahead = (self.times - self.times[0]) * rate - count
        wide = max(2, round(LATE * rate))
        # A row is as old as the earliest of those behind it allow: bursts are spread again.
        places = count + minimum_filter1d(ahead, wide, origin=-(wide // 2))
        places = np.maximum.accumulate(places) - places[0]
        gaps = np.diff(places)
        lost = float((gaps[gaps > GAP] - 1.0).sum())
        if not LOST < lost < MOST_APART * len(count):
            return EvenRows(self, count, np.zeros(len(count), bool))
        rows = np.arange(round(places[-1]) + 1)
        own = np.rint(np.interp(rows, places, count)).astype(np.int64)
        at = self.reference_times
        if at is None and self.reference.shape[:1] == count.shape:  # columns of one table
            at = self.times
        laid = replace(
            self, samples=self.samples[own], times=self.times[0] + rows / rate, reference_times=at
        )
        return EvenRows(laid, np.rint(places).astype(np.int64), np.abs(places[own] - rows) > FAR)

    def on_nominal_rows(self) -> FloatArray:
        """The reference at the rate of the samples."""
        if self.reference_times is None:
            return self.reference
        first, last = self.reference_times[[0, -1]]
        wanted = np.arange(first, last, 1.0 / self.rate)
        if self.reference.ndim == 1:
            return np.interp(wanted, self.reference_times, self.reference)
        columns = [np.interp(wanted, self.reference_times, one) for one in self.reference.T]
        return np.column_stack(columns)


class EvenRows(NamedTuple):
    """Evidence on rows (r,) at a steady rate.

    Attributes
    ----------
    evidence : LoadEvidence
        Its samples are those next in time.
    rows : (t,) int
        Row of each sample of the recording.
    lost : (r,) bool
        Rows that have no sample.
    """

    evidence: LoadEvidence
    rows: IntArray
    lost: BoolArray


def read_evidence(path: Path, *, needed: bool = True) -> LoadEvidence:
    """Read one recording with its reference; without `needed` it may have none, or a useless one.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, no such array, a unit that is not read, numbers that are none.
    """
    readers = {".npz": read_arrays, ".csv": _table, ".mcap": _messages}
    if path.suffix.lower() not in readers:
        raise DataFormatError("evidence of loads is an .npz, .csv or .mcap file", path)
    check_file(path, "samples beside a known load (.npz, .csv or .mcap)", 2**34)
    held = readers[path.suffix.lower()](path)
    there = ", ".join(held) or "none"
    for name in ("samples", "times"):
        if name not in held:
            raise DataFormatError(f"no array {name!r}; its arrays: {there}", path)
    samples = held["samples"]
    if samples.ndim != 2 or samples.dtype.kind not in "uif" or not samples.size:
        raise DataFormatError(f"samples must be numbers (t, n), got shape {samples.shape}", path)
    if samples.dtype.kind == "f" and not np.isfinite(samples).all():
        row, column = np.argwhere(~np.isfinite(samples))[0].tolist()
        raise DataFormatError(
            f"samples hold NaN or infinity, first in row {row}, channel {column}", path
        )
    times = _numbers(held, "times", path)
    if len(times) != len(samples):
        raise DataFormatError(f"{len(times)} times for {len(samples)} samples", path)
    if len(times) < 2 or (np.diff(times) < 0).any() or times[-1] <= times[0]:
        raise DataFormatError("times must rise [s]", path)
    try:
        rate = rate_of_times(times, len(times)) or 0.0
    except InvalidArrayError as error:
        raise DataFormatError(f"{error}: times need parts of a second", path) from None
    if not LEAST_RATE <= rate <= MOST_RATE:
        raise DataFormatError(f"times give {rate:.2g} samples a second: they are seconds", path)
    kind = _kind(held, path, needed)
    try:
        if kind:
            return _with_reference(held, kind, samples, times, path)
    except DataFormatError:
        if needed:
            raise
    return LoadEvidence(path.name, samples, times)


def _with_reference(
    held: dict[str, NDArray[Any]], kind: str, samples: NDArray[Any], times: FloatArray, path: Path
) -> LoadEvidence:
    if kind == PRINTS:
        return _prints(held, samples, times, path)
    if times[-1] - times[0] < LEAST_SECONDS:
        raise DataFormatError(f"{len(times)} samples are too short for rest and a load", path)
    if kind == WRENCH:
        reference = _numbers(held, kind, path, "(u, 6), force [N] and moment [N m]", (6,))
    else:
        reference = _numbers(held, kind, path)
    own = _numbers(held, "reference_times", path) if "reference_times" in held else None
    _check_reference(reference, own, kind, times, path)
    scale = PRESSURES.get(kind) or FORCES.get(kind, 1.0)
    if kind != WRENCH and reference.min() < -0.5 * np.ptp(reference):
        raise DataFormatError(f"{kind} falls to {reference.min():.3g}: a load is positive", path)
    if kind in PRESSURES:
        check_bar(float(reference.max()) * scale, kind, path)
    channels = _channels(held, samples.shape[1], path)
    if channels is not None and kind in PRESSURES and len(channels) < samples.shape[1]:
        raise DataFormatError(
            f"{kind} on {len(channels)} of {samples.shape[1]} channels: a chamber presses on all; "
            "mass_kg with `footprint` and force_n with `channels` press on some",
            path,
        )
    thermal = _thermal(held, samples.shape[1], path)
    return LoadEvidence(
        path.name, samples, times, kind, reference * scale, own, channels, thermal=thermal
    )


def check_bar(top: float, kind: str, path: Path) -> None:
    """Refuse a highest pressure [bar] by which a reference is in another unit.

    Raises
    ------
    DataFormatError
        Names the units that are read.
    """
    if MIN_BAR < top <= MAX_BAR:
        return
    words = f"is it psi, mmHg or another unit? {', '.join(PRESSURES)} are read"
    if kind not in PRESSURES:
        words = (
            "mass_kg and stand are in kg, force_n in N, wrench in N and N m: 1 kg is 9.81 N, 1 N "
            "is 1000 mN, raw counts are none of them; areas are in mm2"
        )
    raise DataFormatError(f"{kind} reaches {top:.2g} bar: {words}", path)


def _thermal(held: dict[str, NDArray[Any]], n: int, path: Path) -> IntArray | None:
    if THERMAL not in held:
        return None
    found = _numbers(held, THERMAL, path)
    if len(found) != n or (found != np.floor(found)).any() or found.min() < -1 or found.max() >= n:
        raise DataFormatError(
            f"{THERMAL} must be {n} channels, one for each, from 0 to {n - 1}, or -1", path
        )
    return found.astype(np.int64)


def _prints(
    held: dict[str, NDArray[Any]], samples: NDArray[Any], times: FloatArray, path: Path
) -> LoadEvidence:
    areas = _numbers(held, PRINTS, path, "areas (k,) [mm2], one a touch of `events`")
    if "events" not in held:
        raise DataFormatError("prints need `events (t,)`: the touch of each row, -1 for none", path)
    events = _numbers(held, "events", path)
    if len(events) != len(samples):
        raise DataFormatError(f"{len(events)} events for {len(samples)} samples", path)
    if (events != np.floor(events)).any() or events.max() >= len(areas) or events.max() < 0:
        raise DataFormatError(
            f"events must be whole numbers to {len(areas) - 1}, one for each of {len(areas)} "
            "prints, and -1",
            path,
        )
    if (areas <= 0).any():
        raise DataFormatError(f"print {int(np.argmin(areas))} has no area", path)
    return LoadEvidence(path.name, samples, times, PRINTS, areas, events=events.astype(np.int64))


def _messages(path: Path) -> dict[str, NDArray[Any]]:
    """Arrays of a recording in MCAP: ours, or of ROS 2 with a topic of samples and a reference.

    Messages with a header have its time, others the time at which they were recorded. A
    `FluidPressure` far from zero is absolute, and counts from its lowest reading.
    """
    index = Index(path)
    if METADATA in index.found.metadata:
        track = read_track(path)
        return {"samples": track.values[:], "times": track.times}
    content, found, topics = Content(index), dict[str, NDArray[Any]](), dict[str, str]()
    for channel in {one.topic: one for one in index.found.copies}.values():
        schema = index.found.schemas.get(channel.schema_id)
        kind = schema.name.replace("/msg/", "/") if schema else ""
        name = _array_of(channel.topic, kind)
        if not name:
            continue
        if name in topics:
            raise DataFormatError(f"two topics of {name}: {topics[name]}, {channel.topic}", path)
        topics[name] = channel.topic
        stamps, values = _columns(content, index.of(channel.topic), kind, path)
        found[name], found["times" if name == "samples" else "reference_times"] = values, stamps
    if "pressure_pa" in found and found["pressure_pa"].min(initial=np.inf) > ABSOLUTE:
        found["pressure_pa"] -= found["pressure_pa"].min()
    return found


def _array_of(topic: str, kind: str) -> str:
    """The array that the messages of a topic are; empty for other messages."""
    last = topic.rpartition("/")[2]
    if kind in ARRAYS:
        return "samples"
    if kind in ("std_msgs/Float32", "std_msgs/Float64"):
        return last if last in (*PRESSURES, *FORCES) else ""
    stamped = {"sensor_msgs/FluidPressure": "pressure_pa", "geometry_msgs/WrenchStamped": WRENCH}
    return stamped.get(kind, "")


def _columns(
    content: Content, messages: Messages, kind: str, path: Path
) -> tuple[FloatArray, NDArray[Any]]:
    """Times (t,) [s] and values (t, ...) of the messages of one topic, in the order of time."""
    stamps, rows = [], []
    for row in messages.order().tolist():
        try:
            one = read(kind, content(messages, row))
        except MessageError as error:
            raise DataFormatError(str(error), path) from None
        head = getattr(one, "header", None)
        stamps.append((nanoseconds_of(head) if head else 0) or messages.times[row])
        if wrench := getattr(one, "wrench", None):
            sides = (
                getattr(side, axis) for side in (wrench.force, wrench.torque) for axis in "xyz"
            )
            rows.append(np.array([*sides]))
        else:
            rows.append(np.asarray(getattr(one, "fluid_pressure", getattr(one, "data", None))))
    if len({row.shape for row in rows}) > 1:
        raise DataFormatError(f"messages of {kind} have different lengths", path)
    return 1e-9 * np.array(stamps, np.float64), np.array(rows)


def _table(path: Path) -> dict[str, NDArray[Any]]:
    """A column `time`, one reference perhaps, and every other column a channel."""
    rows = text_rows(path)
    _, names = next(rows)
    values, _ = table_columns(rows, names, range(len(names)), (), path)
    if not len(values):
        raise DataFormatError("a table without rows", path)
    if "time" not in names:
        raise DataFormatError(f"no column 'time'; its columns: {', '.join(names[:12])}", path)
    known = {*PRESSURES, *FORCES, PRINTS, *(n for n in names if _unit(n)), "reference_times"}
    found = {name: values[:, names.index(name)] for name in names if name in known}
    found["times"] = values[:, names.index("time")]
    channels = [i for i, name in enumerate(names) if name not in known and name != "time"]
    found["samples"] = values[:, channels]
    return found


def _unit(name: str) -> str:
    return next((unit for unit in UNITS if unit in name.lower()), "")


def _kind(held: dict[str, NDArray[Any]], path: Path, needed: bool) -> str:
    """The name of the one reference."""
    found = [name for name in (*PRESSURES, *FORCES, WRENCH, PRINTS) if name in held]
    if not needed:
        found = [name for name in found if name in PRESSURES]
        return found[0] if len(found) == 1 else ""
    for name in held:
        if unit := _unit(name):
            raise DataFormatError(
                f"{name!r} is in another unit: {UNITS[unit]}; {', '.join(PRESSURES)} are read", path
            )
    if len(found) != 1:
        raise DataFormatError(
            f"needs one reference of {', '.join((*PRESSURES, *FORCES, WRENCH, PRINTS))}, it has "
            f"{' and '.join(found) or 'none'}; its arrays: {', '.join(held)}",
            path,
        )
    return found[0]


def _check_reference(
    reference: FloatArray, own: FloatArray | None, kind: str, times: FloatArray, path: Path
) -> None:
    if not len(reference):
        raise DataFormatError(f"{kind} is empty", path)
    if np.ptp(reference) <= 1e-9 * max(1.0, float(np.abs(reference).max())):
        raise DataFormatError(f"{kind} never moves: it teaches nothing", path)
    if own is None:
        if not 0.6 * len(times) <= len(reference) <= 2.0 * len(times):
            raise DataFormatError(
                f"{kind} has {len(reference)} rows for {len(times)} samples: without "
                "reference_times both need the same nominal rate and length",
                path,
            )
        return
    if len(own) != len(reference):
        raise DataFormatError(f"{len(own)} reference_times for {len(reference)} of {kind}", path)
    if (np.diff(own) < 0).any():
        raise DataFormatError("reference_times must rise [s]", path)
    covered = (own[-1] - own[0]) / (times[-1] - times[0])
    if covered < 0.6:
        raise DataFormatError(
            f"{kind} covers {own[-1] - own[0]:.1f} s of {times[-1] - times[0]:.1f} s of samples: "
            "at least 60 % are needed",
            path,
        )


def _channels(held: dict[str, NDArray[Any]], n: int, path: Path) -> IntArray | None:
    """Channels of the array `footprint`, or of `channels`."""
    for name in ("footprint", "channels"):
        if name in held:
            found = _numbers(held, name, path)
            if held[name].dtype.kind == "b" and len(found) == n:
                found = np.flatnonzero(found).astype(np.float64)
            if not len(found) or (found != np.floor(found)).any() or found.min() < 0 or (
                found.max() >= n
            ):  # fmt: skip
                raise DataFormatError(f"{name} must be channels from 0 to {n - 1}", path)
            return np.unique(found.astype(np.int64))
    return None


def _numbers(
    held: dict[str, NDArray[Any]],
    name: str,
    path: Path,
    wanted: str = "finite numbers in one dimension",
    inner: tuple[int, ...] = (),
) -> FloatArray:
    values = np.atleast_1d(held[name])
    if values.dtype.kind not in "buif" or values.shape[1:] != inner:
        raise DataFormatError(f"{name} must be {wanted}, got shape {held[name].shape}", path)
    with in_file(path):
        return check_finite(values, name, (None, *inner))
