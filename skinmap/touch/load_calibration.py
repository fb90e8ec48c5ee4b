"""From counts to bar: what `skinmap calibrate load` fits, and how it is used.

A taxel's pressure is a linear function of the memory features of its counts over its span
(`skinmap.memory_features`). Its zero is found anew in each session: a shift that all taxels share
is taken over only as far as it exceeds what the model itself leaves in doubt. The interval holds
the session: the doubt of the shared shift, the wander of the taxel's own rest, and its gain.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinmap.archive import headed, open_headed
from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, freeze
from skinmap.errors import (
    InvalidArrayError,
    MissingFileError,
    SkinMismatchError,
)
from skinmap.memory_features import FEATURES, MEAN_SECONDS, MemoryState

FORMAT, FILE = "skinmap-load-1", "load.npz"
Zero = Literal["auto", "none", "first"]
NORMAL_90 = 1.645  # standard deviations on either side that hold 90 %
CHUNK = 2000  # rows at once
WANDER = 0.5  # counts that rest wanders within a session, where it was not seen twice
RANGE = 0.03  # beyond the calibrated counts that still are answered, in spans, and one count
GAIN_SD = 0.037  # of a taxel between sessions: six of one insole differ so
REST_DOUBT = 0.65  # counts that a zero differs between sessions at least, by seven of one insole
AFTER_DOUBT = 1.1  # counts that rest after load, less its usual recovery, differs from rest before
UNSEEN_DOUBT = 0.5  # counts more where a recording shows no rest before load
UNEVEN = 0.2  # of a taxel's pressure, where only the mean over several is known
GAIN_BAR = 0.15  # values that a taxel still answers whose gain a session proved wrong
WANDER_BAR = 0.3  # of a taxel's rest within a session, above which it is not answered
# A contact whose pressure falls off as that of two round bodies covers 9/8 of the square of the
# sum through the sum of the squares (Johnson, "Contact Mechanics", 1985, 3.4).
ROUND = 9.0 / 8.0
LEAST_COVERED = 0.2  # of pressed taxels, however far pressures spread
SHRINK = 0.6  # of the error of the best curve without memory: a shared shift below it is doubted
STILL_COUNTS, STILL_LOADED = 1.5, 0.3  # a taxel is stuck that moves less while others moved so far
REST_FAR, REST_CALM = 0.12, 0.03  # of a session's range: how far rest may lie up, how far it moves
TOUCHED = 12.0  # counts above its first rest at which a taxel is touched
SAME_STEP = 0.05  # by which the usual step of rows may differ from that over two seconds
REST_SECONDS, REST_MOST = 0.8, 10.0  # of rest that is needed, and that is looked at


class Covering(NamedTuple):
    """How pressures cover areas, by touches whose prints are known.

    Attributes
    ----------
    spread : float
        Standard deviation of a pressure through the foam [m].
    gain : float
        Area of a print for that of pressed taxels, less the spread.
    doubt : float
        Standard deviation of the logarithm of an area.
    """

    spread: float
    gain: float
    doubt: float

    def area(self, felt: FloatArray | float) -> FloatArray:
        """Covered areas by those that pressed taxels speak for [m2]."""
        less = ROUND * 4.0 * np.pi * self.spread**2
        return self.gain * np.maximum(felt - less, LEAST_COVERED * np.asarray(felt))


class Warmth(NamedTuple):
    """How rest moves with the temperature of a module.

    Attributes
    ----------
    channel : (n,) int
        Channel with the temperature of each taxel's module, -1 for none.
    slope : (n,) float
        Counts of the taxel for a count of the temperature.
    usual : (n,) float
        Temperature at rest in the evidence [counts].
    """

    channel: IntArray
    slope: FloatArray
    usual: FloatArray

    def corrected(self, counts: NDArray[Any]) -> NDArray[Any]:
        """Counts (..., n) as they were at the usual temperature."""
        found = np.array(counts, np.float32)
        own = np.flatnonzero(self.channel >= 0)
        found[..., own] -= self.slope[own] * (counts[..., self.channel[own]] - self.usual[own])
        return found


@dataclass(frozen=True, eq=False, slots=True)
class LoadCalibration:
    """Pressures of n taxels in bar, with intervals that hold on another day.

    Attributes
    ----------
    weights : (n, FEATURES) float
        Of the constant and the memory features [bar]; NaN for taxels that are not answered.
    rest, span : (n,) float
        Counts at rest before load, and signed counts from there to the top of the calibration.
    recovery : (n,) float
        Counts that rest after load lay off rest before it.
    top : (n,) float
        End of the calibrated range [bar].
    error : (n,) float
        Root mean square on held-out stretches of the evidence [bar].
    doubt : float
        Of a session's shared shift [bar].
    rate : float
        Samples a second of the evidence.
    model : str
        Step of the ladder: linear, cubic or hysteresis.
    shift : (n,) float
        Counts that the last zeroing moved the rest by.
    zeroed : float
        When that was [s since 1970]; of evidence that does not say, when it was fitted.
    area_mm2 : float
        Of a taxel; NaN where nobody said.
    fingerprint : str
        Of the skin; empty where nobody said.
    mean_s : float
        Running mean of the counts that the weights are for [s].
    covering : Covering or None
        Areas as prints teach them; None without any.
    warmth : Warmth or None
        Effect of the temperatures of modules; None where they are not known.
    uneven : float
        Standard deviation of a taxel's gain by contact that was not even: `UNEVEN` where masses or
        forces gave the mean over several taxels, else 0.
    """

    weights: FloatArray
    rest: FloatArray
    span: FloatArray
    recovery: FloatArray
    top: FloatArray
    error: FloatArray
    doubt: float
    rate: float
    model: str
    shift: FloatArray
    zeroed: float
    area_mm2: float = float("nan")
    fingerprint: str = ""
    mean_s: float = MEAN_SECONDS
    covering: Covering | None = None
    warmth: Warmth | None = None
    uneven: float = 0.0

    def __post_init__(self) -> None:
        n = len(self.rest)
        shapes = dict.fromkeys(ARRAYS, (n,)) | {"weights": (n, FEATURES)}
        for name, shape in shapes.items():
            if (found := getattr(self, name).shape) != shape:
                raise InvalidArrayError(f"{name} must have shape {shape}, got {found}")
        freeze(self)

    def __len__(self) -> int:
        return len(self.rest)

    @property
    def answered(self) -> BoolArray:
        """Taxels (n,) whose pressure is known."""
        return np.isfinite(self.weights[:, 0])

    @property
    def count_bar(self) -> float:
        """What a count is worth: median of the taxels [bar]."""
        own = self.answered
        return float(np.median((self.top / np.abs(self.span))[own])) if own.any() else 0.0

    @classmethod
    def read(cls, path: Path | str, *, fingerprint: str = "") -> LoadCalibration:
        """Read what `skinmap calibrate load -o` wrote: its folder, or the file in it.

        Raises
        ------
        MissingFileError, DataFormatError
            No such file, or not one of ours.
        SkinMismatchError
            Calibrated was another skin.
        """
        path = Path(path)
        path = path / FILE if path.is_dir() else path
        if not path.is_file():
            raise MissingFileError(path, "a calibration made by `skinmap calibrate load -o`")
        with open_headed(path, FORMAT, "a calibration of loads") as (head, arrays):
            head = {"mean_s": MEAN_SECONDS, "uneven": 0.0} | head
            held: dict[str, Any] = {name: np.asarray(arrays[name], np.float64) for name in ARRAYS}
            known = {name: kind(head[name]) for name, kind in HEAD.items()}
            if prints := head.get("covering"):
                known["covering"] = Covering(*map(float, prints))
            if "warmth" in arrays:
                channel, slope, usual = np.asarray(arrays["warmth"], np.float64)
                known["warmth"] = Warmth(channel.astype(np.int64), slope, usual)
            found = cls(**held, **known)
        if fingerprint and found.fingerprint and fingerprint != found.fingerprint:
            raise SkinMismatchError(
                f"{path}: calibrated was the skin {found.fingerprint[:8]}, this is "
                f"{fingerprint[:8]}"
            )
        return found

    def to_bytes(self) -> bytes:
        """The file that `read` takes."""
        head = {"format": FORMAT} | {name: getattr(self, name) for name in HEAD}
        head["covering"] = self.covering
        arrays: dict[str, Any] = {name: getattr(self, name) for name in ARRAYS}
        if self.warmth is not None:
            arrays["warmth"] = np.stack(self.warmth)
        return headed(head, arrays)

    def pressures(
        self, samples: ArrayLike, times: ArrayLike | None = None, *, zero: Zero = "auto"
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pressures of a recording with their 90 % intervals.

        Parameters
        ----------
        samples : (t, n) array-like
            Raw counts.
        times : (t,) array-like, optional
            [s]; without them the rate of the evidence is taken.
        zero : str
            `auto` and `first` find rest before load in the samples, `auto` beside rest after it;
            `none` keeps the zero of the calibration.

        Returns
        -------
        values, low, high : (t, n) float32
            [bar]; NaN where a taxel is not answered or above the calibrated range.

        Raises
        ------
        InvalidArrayError, SkinMismatchError
            Samples or times of another shape, or that hold NaN.
        """
        counts = self.cooled(self.checked(samples))
        rate = rate_of_times(times, len(counts)) or self.rate
        session = self.session(counts, rate, zero=zero)
        found = np.full((3, *counts.shape), np.nan, np.float32)
        stream = LoadStream(self, rate, session)
        for rows in chunks(len(counts)):
            found[:, rows] = stream.rows(counts[rows])
        return found[0], found[1], found[2]

    def checked(self, samples: ArrayLike) -> FloatArray:
        """Samples of as many taxels, without NaN; whole numbers stay as small as they are."""
        counts = np.asarray(samples)
        if counts.ndim != 2 or counts.dtype.kind not in "uif":
            raise InvalidArrayError(f"samples must be numbers (t, n), got shape {counts.shape}")
        if counts.shape[1] != len(self):
            raise SkinMismatchError(f"{counts.shape[1]} taxels, calibrated are {len(self)}")
        if counts.dtype.kind == "f" and not np.isfinite(counts).all():
            row, column = np.argwhere(~np.isfinite(counts))[0].tolist()
            raise InvalidArrayError(
                f"samples hold NaN or infinity, first in row {row}, channel {column}"
            )
        return counts

    def cooled(self, counts: NDArray[Any]) -> NDArray[Any]:
        """Counts (..., n) as they were at the usual temperature of the modules."""
        return counts if self.warmth is None else self.warmth.corrected(counts)

    def above_rest(self, counts: ArrayLike) -> FloatArray:
        """Counts (n,) by which taxels are pressed, whether theirs rise or fall; none below 0."""
        away = self.cooled(np.asarray(counts, np.float64)) - self.rest - self.shift
        return np.asarray(np.maximum(away * np.sign(self.span), 0.0))

    def steady(self, counts: ArrayLike) -> FloatArray:
        """Pressure (n,) [bar] of a load that stands still; NaN where a taxel is not answered."""
        scaled = (self.cooled(np.asarray(counts, np.float64)) - self.rest - self.shift) / self.span
        curve = self.weights[:, :4] * np.power.outer(scaled, np.arange(4))
        return np.asarray(np.maximum(curve.sum(axis=1), 0.0))

    def session(self, counts: FloatArray, rate: float, *, zero: Zero = "auto") -> Session:
        """Zero of a recording: its rest before load, where it has any."""
        gain, stuck = self._ends(counts)
        before, after = (None, None) if zero == "none" else self.rests(counts, rate)
        if zero == "first":
            after = None
        found = self._unseen(after) if before is None else self._zeroed(before, after)
        return replace(found, gain=gain, wander=np.where(stuck, np.inf, found.wander))

    def _zeroed(self, before: FloatArray, after: FloatArray | None = None) -> Session:
        """Shift of each taxel, what all share shrunk by what is in doubt."""
        moved, wander = before - self.rest, np.full(len(self), np.nan)
        if after is not None:
            late = after - self.recovery - self.rest
            wander = np.abs(late - moved) / 2
            moved = (moved + late) / 2
        own = self.answered
        slope = self.top / self.span  # bar a count
        shared = float(np.median((moved * slope)[own])) if own.any() else 0.0
        kept = max(0.0, 1.0 - (self.doubt / max(abs(shared), 1e-12)) ** 2)
        shift = moved - (1.0 - kept) * shared / slope
        return Session(shift, wander * np.abs(slope), np.zeros(len(self)), self.doubt, True)

    def _unseen(self, after: FloatArray | None = None) -> Session:
        """A session without rest before its load; rest after it shows a zero that moved far."""
        n, shared = len(self), float(np.hypot(self.doubt, UNSEEN_DOUBT * self.count_bar))
        shift, own = self.shift, self.answered
        if after is not None and own.any():
            doubt, slope = AFTER_DOUBT * self.count_bar, self.top / self.span
            doubt *= 1.0 if self.recovery.any() else 2.0  # how far it recovers was not seen
            moved = float(np.median(((after - self.recovery - self.rest - shift) * slope)[own]))
            kept = max(0.0, 1.0 - (doubt / max(abs(moved), 1e-12)) ** 2)
            shift = shift + kept * moved / slope
            shared = float(np.hypot(shared, kept * doubt))
        return Session(shift, np.full(n, np.nan), np.zeros(n), shared, False)

    def rests(self, counts: FloatArray, rate: float) -> tuple[FloatArray | None, FloatArray | None]:
        """Counts (n,) at rest before load and after it; None where a recording has none."""
        own = self.answered
        if not own.any():
            return None, None
        level = skin_level(counts, own, self.rest, self.span)
        return calm_rests(counts, level, rate, up=np.sign(self.span))

    def _ends(self, counts: FloatArray) -> tuple[FloatArray, BoolArray]:
        """How far taxels went beyond calibrated counts and the others; which stood still then."""
        ends = np.percentile(counts, (0.1, 99.9), axis=0)
        scaled = (ends - self.rest - self.shift) / self.span
        own, most = self.answered, scaled.max(axis=0)
        if not own.any() or np.median(np.ptp(scaled[:, own], axis=0)) <= STILL_LOADED:
            none = np.zeros(len(self))  # nothing pressed on all of them: they may differ
            return none, none > 0
        usual = max(float(np.median(most[own])), 1.0)
        return np.maximum(most - usual, 0.0), np.ptp(ends, axis=0) < STILL_COUNTS

    def zero_at(self, samples: ArrayLike, when: float) -> LoadCalibration:
        """The calibration zeroed anew by samples (t, n) at rest."""
        counts = self.cooled(self.checked(samples))
        session = self._zeroed(np.median(counts, axis=0))
        return replace(self, shift=session.shift, zeroed=when)

    def stream(self, rate: float | None = None) -> LoadStream:
        """Pressures of moments as they come, on the zero of this calibration."""
        return LoadStream(self, rate or self.rate, self._unseen())


ARRAYS = ("weights", "rest", "span", "recovery", "top", "error", "shift")
HEAD: dict[str, Any] = {
    "doubt": float, "rate": float, "model": str, "zeroed": float, "area_mm2": float,
    "fingerprint": str, "mean_s": float, "uneven": float,
}  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class Session:
    """Zero of one session.

    Attributes
    ----------
    shift : (n,) float
        Counts from the calibration's rest to this session's.
    wander : (n,) float
        Half the difference of the two rests [bar]; NaN where there was one at most, infinite for
        a taxel that stood still while the others were loaded.
    gain : (n,) float
        How far a taxel went beyond its calibrated counts and the other taxels, against its span.
    shared : float
        Standard deviation of what all taxels share [bar].
    zeroed : bool
        Whether the session had a rest before load.
    """

    shift: FloatArray
    wander: FloatArray
    gain: FloatArray
    shared: float
    zeroed: bool


class LoadStream:
    """Pressures of rows as they come, with the memory of those before."""

    def __init__(self, calibration: LoadCalibration, rate: float, session: Session) -> None:
        self._calibration, self._rate, self.session = calibration, rate, session
        self._state: MemoryState | None = None

    def zero(self, samples: ArrayLike) -> None:
        """Set the zero by samples (t, n) at rest."""
        fresh = self._calibration.zero_at(samples, self._calibration.zeroed)
        shared = self._calibration.doubt
        self.session = replace(self.session, shift=fresh.shift, shared=shared, zeroed=True)
        self._state = None

    def update(self, sample: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Values, low and high (n,) [bar] of one moment (n,) of counts."""
        found = self.rows(self._calibration.cooled(np.asarray(sample, np.float64)[None]))
        return found[0, 0], found[1, 0], found[2, 0]

    def rows(self, counts: FloatArray) -> FloatArray:
        """Values, low and high (3, t, n) [bar] of rows (t, n) that follow, cooled."""
        model = self._calibration
        scaled = (counts - model.rest - self.session.shift) / model.span
        if self._state is None:
            self._state = MemoryState(scaled[0], self._rate, model.mean_s)
        features = self._state.steps(scaled)
        raw = np.einsum("tfn,nf->tn", features, model.weights[:, 1:]) + model.weights[:, 0]
        values = np.maximum(raw, 0.0)
        half = NORMAL_90 * self.spread(values)
        beyond = scaled > 1.0 + RANGE + 1.0 / np.abs(model.span)
        beyond |= raw > (1.0 + RANGE) * model.top
        proven = self.session.gain > 2 * RANGE + 2.0 / np.abs(model.span)
        beyond |= proven & (values > GAIN_BAR)
        beyond |= np.nan_to_num(self.session.wander) > WANDER_BAR
        found = np.stack([values, np.maximum(values - half, 0.0), values + half])
        found[:, beyond] = np.nan
        return found

    def spread(self, values: FloatArray) -> FloatArray:
        """Standard deviation [bar] of values (t, n), what a session shares included."""
        model, wander = self._calibration, self.session.wander
        usual = WANDER * np.abs(model.top / model.span)
        own = np.where(np.isfinite(wander), np.maximum(wander, usual), usual)
        gain = np.hypot(GAIN_SD, model.uneven)
        total = model.error**2 + self.session.shared**2 + own**2 + (gain * values) ** 2
        return np.asarray(np.sqrt(total))


def skin_level(
    counts: FloatArray, own: BoolArray, rest: FloatArray, span: FloatArray
) -> FloatArray:
    """Median (t,) over some taxels of counts (t, n) above rest, in spans."""
    parts = [
        np.median((counts[rows][:, own] - rest[own]) / span[own], axis=1)
        for rows in chunks(len(counts))
    ]
    return np.concatenate(parts)


def calm_rests(
    counts: FloatArray, level: FloatArray, rate: float, *, up: FloatArray | None = None
) -> tuple[FloatArray | None, FloatArray | None]:
    """Rest (n,) before the first load and after the last, by a level (t,) of the whole skin.

    With `up` (n,), the sign by which counts answer a load, rows in which a few taxels are touched
    are no part of their rest: the level does not show them.
    None where the samples begin or end under load, or never hold still there.
    """
    wide = max(1, round(0.5 * rate))
    padded = np.concatenate([np.zeros(1), np.cumsum(np.pad(level, (wide - 1, 0), mode="edge"))])
    smooth = (padded[wide:] - padded[:-wide]) / wide
    low, high = (float(one) for one in np.percentile(smooth, (1, 99)))
    reach, needed = high - low, round(REST_SECONDS * rate)

    def first_calm(level: FloatArray, counts: FloatArray) -> FloatArray | None:
        if len(level) < 2 * needed or level[needed] - low > REST_FAR * reach:
            return None
        moved = np.abs(level - np.median(level[:needed])) > REST_CALM * reach
        end = int(0.8 * (np.argmax(moved) if moved.any() else len(level)))
        if end < needed:
            return None
        calm = counts[: min(end, round(REST_MOST * rate))]
        found = np.median(calm, axis=0).astype(np.float64)
        if up is not None:
            touched = up * (calm - np.median(calm[:needed], axis=0)) > TOUCHED
            for k in np.flatnonzero(touched.any(axis=0)):
                found[k] = np.median(calm[~touched[:, k], k])
        return found

    return first_calm(smooth, counts), first_calm(smooth[::-1], counts[::-1])


def rate_of_times(times: ArrayLike | None, count: int) -> float | None:
    """Samples a second by times (t,) [s]; None without them.

    Raises
    ------
    InvalidArrayError
        Another number of times, or times that do not rise.
    """
    if times is None:
        return None
    found = check_finite(times, "times", (count,))
    steps = np.diff(found)
    if len(steps) and not (steps >= 0).all():
        row = int(np.argmax(steps < 0)) + 1
        raise InvalidArrayError(f"times must not fall, row {row} does")
    usual = float(np.median(steps)) if len(steps) else 0.0
    # Rows in bursts, or under a coarse clock, have no step of their own: over two seconds they do.
    wide = min(max(20, round(2.0 * len(steps) / max(found[-1] - found[0], 1e-9))), len(steps))
    step = float(np.median(found[wide:] - found[:-wide])) / wide if wide else 0.0
    step = usual if abs(usual - step) < SAME_STEP * step else step
    if step <= 0:
        raise InvalidArrayError("times stand still: at least two samples a second are needed")
    return 1.0 / step


def chunks(count: int) -> Iterator[slice]:
    """Rows in parts that fit into memory with their features."""
    return (slice(start, start + CHUNK) for start in range(0, count, CHUNK))
