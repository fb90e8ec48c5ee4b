"""What is wrong with samples: counted, mended where it can be, left out where not."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import warn
from skinmap.io.recordings.recorded_stream import EVEN, SMALLER, rate_by_times
from skinmap.live.sources.source import Block, Counts, StreamInfo
from skinmap.touch.contacts.skin_geometry import ACTIVE

RANGE = (0.0, 255.0)  # counts
FAR = 2 * RANGE[1]  # noise and a gain reach less beyond the range
JUMP = 1.0  # a clock that goes on by so much more than time passed was set anew [s]
LATE = 0.1  # a live clock that goes back by more, and by more than `ORDER` periods, as well [s]
ORDER = 5.0
LATER = 0.75  # periods that a sample may come late before one is missed
FORGIVE = 0.9  # a clock that is off by a few percent must not add up to missed samples
SOON = 2.0  # after so long what is missing or odd is named [s]
PEAK = 40.0  # times the mean: so far noise at rest does not reach, touches do
TINY = 1e-30  # no sensor sends so little: counts in the other byte order do
SEVERAL = 3  # channels that fall or rise: one alone drifts
SHARE = 0.05  # the least slow mean of a touched channel, as a share of full scale
STEPS = 3  # of a clock that are logged
logger = logging.getLogger(__name__)


def fall_of(rate: float) -> float:
    """By how much a clock of samples of a rate [Hz] falls where it begins anew [s]."""
    return max(LATE, ORDER / rate if rate > 0 else 0.0)


def odd_times(step: float, info: StreamInfo) -> str:
    """That samples lie as far apart [s] as if times were in smaller units; else empty."""
    steps = step * info.rate
    for unit, scale in SMALLER.items():
        if 0.8 < steps / scale < 1.25:
            return f"the times of {info.name!r} look like {unit}: they are seconds"
    return ""


def check_range(values: NDArray[Any], info: StreamInfo) -> bool:
    """Whether values (k, channels) can be counts; a warning where they are of more than 8 bits."""
    top = float(np.max(values, initial=0.0, where=np.isfinite(values)))
    if top <= FAR:
        return True
    warn(
        f"{info.name!r} sends values up to {top:g}: {info.kind} values are 0 to 255 counts, and "
        "larger ones are cut off. Scale them at the source, or read a recording of them by a "
        "mapping with full_scale (docs/own_recordings.md)"
    )
    return False


class SampleChecks:
    """Looks at blocks before they are used.

    Parameters
    ----------
    info : StreamInfo
    counts : Counts
        That it adds to.
    seekable : bool
        A recording: where its time jumps, it was led there.
    taxels : (N,) int, optional
        Channels that numbers are expected of; all by default.

    Attributes
    ----------
    silent : (channels,) bool
        Those of them that never sent a number.
    unheard : int
        How many they are.
    """

    def __init__(
        self, info: StreamInfo, counts: Counts, *, seekable: bool, taxels: IntArray | None = None
    ) -> None:
        self._info, self._counts, self._seekable = info, counts, seekable
        self._last = self._arrived = float("nan")
        self._behind = 0.0  # periods that samples are late by now
        self._good: NDArray[Any] = np.zeros(info.channels, np.float64)
        self._in_range = True  # until a sample lies far beyond
        self.silent: BoolArray = np.zeros(info.channels, bool)
        self.silent[slice(None) if taxels is None else taxels] = True
        self.unheard = int(self.silent.sum())
        # What the first seconds are watched for: how large values are, and on how many channels.
        self._enough = round(SOON * (info.rate or 50.0))
        self._rows, self._misfits, self._top, self._sum = 0, 0, 0.0, 0.0
        self._watched, self._told, self._timed, self._odd = True, False, False, 0
        self._seen: list[float] = []  # times that the told rate is compared with
        self._compared = info.rate <= 0
        self._missed = 0  # of the samples that are lost, those before it was compared
        self._stood: FloatArray | None = None  # a slow mean of the values (channels,)

    def forget(self) -> None:
        """The recording was led elsewhere: the next sample may be the last one once more."""
        self._last, self._behind = float("nan"), 0.0

    def look(self, block: Block) -> Iterator[tuple[bool, FloatArray, NDArray[Any]]]:
        """Runs of good samples: whether the clock began anew, times (k,), values (k, channels)."""
        self._counts.received += len(block)
        if not len(block):
            return
        width = block.values.shape[1]
        if width != self._info.channels:
            self._counts.add_misfits(len(block), width, self._info.channels)
            self._misfits += len(block)
            if self._misfits - len(block) < self._enough <= self._misfits:
                self._warn(f"{width} values a sample, not {self._info.channels}: none is used")
            return
        self._misfits = 0
        values = self._mended(block.values)
        if self._watched and block.values.dtype.kind in "fi":
            self._watch(block.values)
        passed, self._arrived = block.arrived - self._arrived, block.arrived
        last = block.times[0] if self._last != self._last else self._last
        steps = np.diff(block.times, prepend=last)
        # What is missing takes time; where none has passed here, only the clock went on. What
        # comes first may have waited: its clock goes wrong only where all of its steps are long.
        late = passed != passed and np.median(steps) > JUMP
        jumped = bool(late or steps.max() > passed + JUMP)
        rows: list[int] = []
        anew = False
        for row, time in enumerate(block.times.tolist()):
            verdict = self._verdict(time, jumped or self._seekable)
            if verdict == "anew":
                if rows:
                    yield anew, block.times[rows], values[rows]
                rows, anew = [], True
                self._seen = []
                self._counts.restarts += 1
                self._check_times(time - self._last)
                if not self._seekable and self._counts.restarts <= STEPS:
                    logger.warning(
                        "the clock of %r stepped by %.3g s", self._info.name, time - self._last
                    )
            else:
                self._odd = 0
            if verdict != "drop":
                rows.append(row)
                self._last = time
                if not self._compared:
                    self._compare_rate(time)
        if len(rows) == len(block):
            yield anew, block.times, values
        elif rows:
            yield anew, block.times[rows], values[rows]

    def _compare_rate(self, time: float) -> None:
        """Believe the times, not the told rate, where the first second of them contradicts it."""
        self._seen.append(time)
        told = self._info.rate
        if len(self._seen) <= max(EVEN, told):
            return
        self._compared = True
        # Samples that share a time are left out: the others then tell no rate.
        found = told if self._counts.repeated else rate_by_times(np.array(self._seen), told)
        if found != told:
            self._counts.lost -= self._missed
            self._behind = 0.0
            self._info = replace(self._info, rate=found)
            name = self._info.name
            warn(f"{name!r} states {told:g} samples a second, its times give {found:.4g}", above=2)

    def _check_times(self, step: float) -> None:
        """Warn once of samples that lie as far apart as if times were in smaller units."""
        found = odd_times(step, self._info)
        self._odd = self._odd + 1 if found else 0  # a pause may be so long once
        if self._odd >= STEPS and not self._timed:
            self._timed = True
            warn(found, above=2)

    def _verdict(self, time: float, jumps: bool) -> str:
        """What becomes of a sample of this time: "use", "drop", or "anew": first of a new run.

        `jumps` where a long step is one of the clock, not of samples that are missing.
        """
        step = time - self._last
        rate = self._info.rate
        if step != step:  # NaN: the first one
            return "use"
        if step == 0:
            self._counts.repeated += 1
            return "drop"
        if step < 0:
            if self._seekable or -step > fall_of(rate):
                self._behind = 0.0
                return "anew"
            self._counts.late += 1
            return "drop"
        if jumps and step > JUMP and step * rate > 1.5:
            self._behind = 0.0
            return "anew"
        if rate > 0:
            self._behind = max(FORGIVE * self._behind + step * rate - 1.0, -1.0)
            if self._behind >= LATER:
                missed = round(self._behind)
                self._counts.lost += missed
                self._missed += missed
                self._behind -= missed
        return "use"

    def _mended(self, values: NDArray[Any]) -> NDArray[Any]:
        """The values without NaN, infinity and what lies out of the range of counts."""
        # False for NaN.
        if values.dtype == np.uint8 or (RANGE[0] <= values.min() and values.max() <= RANGE[1]):
            self._hear(np.True_)
            self._good = values[-1]
            return values
        values = np.array(values, np.float64)
        bad = ~np.isfinite(values)
        self._hear(~bad.all(axis=0))
        self._counts.nan += int(bad.any(axis=1).sum())
        for row in np.flatnonzero(bad.any(axis=1)).tolist():
            before = values[row - 1] if row else self._good
            values[row, bad[row]] = before[bad[row]]
        outside = ((values < RANGE[0]) | (values > RANGE[1])).any(axis=1)
        self._counts.out_of_range += int(outside.sum())
        if self._in_range:
            self._in_range = check_range(values, self._info)
        values = np.clip(values, *RANGE)
        self._good = values[-1]
        return values

    def _hear(self, some: NDArray[np.bool_] | np.bool_) -> None:
        """Note which channels (channels,) sent a number."""
        if self.unheard:
            self.silent = self.silent & ~some
            self.unheard = int(self.silent.sum())

    def _watch(self, values: NDArray[Any]) -> None:
        """Warn once of values (k, channels) that are none, or of another scale or sign."""
        self._rows += len(values)
        self._top = max(self._top, float(np.max(values, initial=0.0, where=np.isfinite(values))))
        self._sum += float(np.nansum(np.abs(values))) / max(values.size, 1) * len(values)
        known = np.nan_to_num(values.astype(np.float64))
        stood = known[0] if self._stood is None else self._stood
        self._stood = stood + (known[-1] - stood) * min(1.0, len(values) / self._enough)
        if self._rows < self._enough:
            return
        if self.unheard and not self._told:
            self._told = True
            self._warn(
                f"no number on {self.unheard} of {len(self.silent)} channels so far, "
                f"{int(np.argmax(self.silent))} the first: they feel nothing"
            )
        # A drift is followed; a touch is as large as this at once, on several channels.
        falls = ((known - stood <= -ACTIVE) & (known < 0)).any(axis=0).sum() >= SEVERAL
        shares = (self._stood >= SHARE).sum() >= SEVERAL  # of noise the mean is small
        if (
            shares
            and self._top <= 1.0
            and self._top * self._rows > PEAK * self._sum
            and self._top % 1.0
        ):
            self._warn(
                f"values up to {self._top:.3g}, like shares of 1: multiply them by 255, if they are"
            )
        elif 0.0 < self._top < TINY:
            self._warn(f"values up to {self._top:.3g}, like numbers with their bytes turned round")
        elif self._top <= ACTIVE and falls:
            self._warn(f"values down to {np.nanmin(values):.4g}: turn their sign, all are cut off")
        elif self._top <= ACTIVE:
            return
        self._watched = False

    def _warn(self, found: str) -> None:
        warn(f"{self._info.name!r} sends {found}", above=2)
