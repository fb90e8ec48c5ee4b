"""Response of a skin: baseline, noise, threshold, gain and health of each taxel.

Files of response calibrations: a zip of plain arrays with a head in JSON.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibration.response.gain import (
    BranchFollower,
    Gain,
    ReferenceLoads,
    explained,
    fit_gain,
    lag_of,
)
from skinmap.archive import headed, open_headed
from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, freeze
from skinmap.errors import (
    InvalidArrayError,
    MissingFileError,
    SkinMismatchError,
    UnknownNameError,
)
from skinmap.io.output import staged_file
from skinmap.summary import Summary

RATE = 50.0  # samples a second
FEWEST = 50  # samples at rest: a second
NORMAL_95 = 1.645  # 95th percentile of normal noise, in deviations
MARGIN = 4.0  # counts above the noise's 95th percentile that make a touch
LEAST_NOISE = 0.3  # counts: quantisation alone has a deviation of 1 / sqrt(12)
NOISY = 5.0  # times the median noise of the skin
RANGE = (0.0, 255.0)
RATES = (1.0, 1e4)  # samples a second: beyond them times are in another unit
VOLTS, STILL = 10.0, 0.1  # fractions that stay below, with less noise than this, are no counts
RESTLESS = 5.0  # times the noise of a taxel: at rest it moves further in 5 % of samples at most
COMMON = 4.0 * MARGIN  # counts that all taxels move together at rest at most
TOUCHED = 0.2  # share of restless taxels at which the skin did not rest
EXPLAINED = 0.75  # of the answers under load, that the curves of half of the taxels must explain
FREE = 2.5  # time constant of a free baseline [s]: a press rises quicker than drift by far
RELEASED = 0.25  # of a touch's height: a fall below it is the end of the touch
SETTLING = 0.5  # time constant after a release, while the reading may still creep [s]
LONG = 2.0  # a touch that lasts so long creeps [s]; drift is nothing in shorter ones
WALK = 0.05  # most that an own drift may be [counts/s]: 20 in ten minutes and half as much again
FREE_CHANNELS = 3  # free taxels whose mean is the drift of a module; one thermal channel is enough
RIDGE = 1.0  # counts squared: a common drift below one count is taken over as it is


class Health(StrEnum):
    """What is known of a taxel's state."""

    OK = "ok"
    DEAD = "dead"  # was loaded and did not move
    STUCK = "stuck"  # not the least noise, away from the ends of the range
    SATURATED = "saturated"  # rests at an end of the range
    NOISY = "noisy"
    NEVER_TOUCHED = "never touched"  # looks well, no load has proved it yet


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class ResponseCalibration(Summary):
    """How each of n channels answers.

    Attributes
    ----------
    baseline, noise, threshold : (n,) float
        At rest, its robust standard deviation, and the deviation that is a touch [counts].
    sign : int
        1 where harder presses read higher, -1 where they read lower (the iCub's raw values).
    health : (n,) str
        Names of `Health`.
    gain : Gain or None
        Load curves, where reference loads were given.
    rate : float
        Samples a second that drift is tracked at.
    fingerprint : str
        Of the skin, where it is known (`skinmap.skin.skin.fingerprint`).
    modules : (n,) int or None
        Module of each channel: its free channels tell the drift of those pressed.
    thermal : (n,) bool or None
        Channels that feel temperature and no touch.

    Examples
    --------
    >>> import numpy as np, skinmap
    >>> rest = np.random.default_rng(0).normal(40.0, 1.0, (500, 12))
    >>> response = skinmap.ResponseCalibration.fit(rest)
    >>> pressures = response.apply(np.full((1, 12), 90.0))
    >>> pressures.shape, bool((abs(pressures - 50.0) < 1.0).all())
    ((1, 12), True)
    """

    baseline: FloatArray
    noise: FloatArray
    threshold: FloatArray
    sign: int
    health: NDArray[np.str_]
    gain: Gain | None = None
    rate: float = RATE
    fingerprint: str = ""
    modules: IntArray | None = None
    thermal: BoolArray | None = None

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(self.baseline))
        wanted = (n,)
        arrays: dict[str, NDArray[Any]] = {
            name: check_finite(getattr(self, name), name, wanted)
            for name in ("baseline", "noise", "threshold")
        }
        others = {"health": self.health, "modules": self.modules, "thermal": self.thermal}
        for name, values in others.items():
            if values is None:
                continue
            if np.shape(values) != wanted:
                raise InvalidArrayError(f"{name} must have shape {wanted}, got {np.shape(values)}")
            arrays[name] = np.asarray(values)
        unknown = set(self.health.tolist()) - set(Health)
        if unknown:
            raise UnknownNameError("health state", min(unknown), Health)
        if self.sign not in (1, -1):
            raise InvalidArrayError(f"sign must be 1 or -1 for all channels, got {self.sign}")
        if not (np.isfinite(self.rate) and self.rate > 0):
            raise InvalidArrayError(f"rate must be above 0 samples a second, got {self.rate}")
        if self.gain is not None and len(self.gain.counts) != n:
            raise InvalidArrayError(f"{len(self.gain.counts)} gain curves for {n} channels")
        freeze(self, **arrays)

    def __len__(self) -> int:
        return len(self.baseline)

    @classmethod
    def fit(
        cls,
        rest: ArrayLike,
        reference: ReferenceLoads | None = None,
        *,
        sign: int = 1,
        rate: float = RATE,
        modules: ArrayLike | None = None,
        thermal: ArrayLike | None = None,
        fingerprint: str = "",
    ) -> ResponseCalibration:
        """Learn the response from samples at rest and, where there are any, reference loads.

        Parameters
        ----------
        rest : (t, n) array-like
            Nothing touches the skin; five to ten seconds [counts].
        reference : ReferenceLoads, optional
            Samples under known loads.
        sign : int
            1 or -1, see the attribute.
        rate : float
            Samples a second.
        modules : (n,) array-like of int, optional
            Module of each channel.
        thermal : (n,) array-like of bool, optional
            Channels that feel temperature and no touch.
        fingerprint : str
            Of the skin.

        Returns
        -------
        ResponseCalibration
            Of n channels.

        Raises
        ------
        InvalidArrayError
            NaN (names the row), fewer than a second of samples, another number of taxels under
            load than at rest, samples far beyond 0 to 255 or in volts, a rate beyond 1 to 10,000,
            a sign that most taxels contradict, a skin that was touched at rest, or loads that do
            not explain the samples.
        """
        samples = check_finite(rest, "rest", (None, None))
        if len(samples) < FEWEST:
            raise InvalidArrayError(
                f"rest needs at least {FEWEST} samples, got {len(samples)}: five to ten seconds"
            )
        if reference is not None and reference.samples.shape[1] != samples.shape[1]:
            raise InvalidArrayError(
                f"{reference.samples.shape[1]} taxels under load, {samples.shape[1]} at rest"
            )
        highest = float(max(samples.max(), 0.0 if reference is None else reference.samples.max()))
        if highest > 2.0 * RANGE[1]:  # noise and a gain reach less beyond the range
            raise InvalidArrayError(
                f"samples reach {highest:g}; raw values are {RANGE[0]:g} to {RANGE[1]:g} counts"
            )
        if rate > 0 and not RATES[0] <= rate <= RATES[1]:
            raise InvalidArrayError(f"{rate:g} samples a second: are `times` in seconds?")
        quiet = reference is not None or np.median(samples.std(axis=0)) < STILL
        if highest < VOLTS and quiet and (samples != np.rint(samples)).any():
            raise InvalidArrayError(
                f"samples reach {highest:.2g} in fractions: are they volts? raw values are "
                f"{RANGE[0]:g} to {RANGE[1]:g} counts"
            )
        baseline = np.median(samples, axis=0)
        if reference is not None:
            _check_sign(reference, baseline, sign)
        deviation = sign * (samples - baseline)
        noise = 1.4826 * np.median(np.abs(deviation), axis=0)
        # Whole counts: a median deviation of zero hides noise below half a count.
        noise = np.maximum(noise, np.minimum(samples.std(axis=0), LEAST_NOISE))
        threshold = np.percentile(deviation, 95, axis=0) + MARGIN
        moved = restless(samples, baseline, noise)
        _check_rest(deviation, moved)
        # A touch would be the noise of its channels, and deafen them.
        threshold[moved] = NORMAL_95 * noise[moved] + MARGIN
        health = _health(samples, baseline, noise, threshold, reference, sign)
        gain = None
        if reference is not None:
            gain = fit_gain(reference, baseline, sign)
            _check_gain(gain, reference, baseline, sign, health == Health.OK)
        return cls(
            baseline,
            noise,
            threshold,
            sign,
            health,
            gain,
            float(rate),
            fingerprint,
            None if modules is None else np.asarray(modules, np.int64),
            None if thermal is None else np.asarray(thermal, np.bool_),
        )

    def track(self, rate: float | None = None) -> DriftTracker:
        """A tracker that follows a live stream of `rate` samples a second, block after block.

        Without a rate it follows samples at that of the calibration.
        """
        return DriftTracker(
            self.baseline,
            self.threshold,
            self.sign,
            rate or self.rate,
            modules=self.modules,
            thermal=self.thermal,
            trusted=self._fit_to_use(),
        )

    def apply(self, samples: ArrayLike, *, tracker: DriftTracker | None = None) -> FloatArray:
        """Pressures (t, n) for samples (t, n): counts above the tracked baseline, or loads.

        Values below a taxel's threshold, and channels that are dead, stuck, saturated, noisy or
        thermal, give 0. Pass the `tracker` of the last block to go on with its baselines.

        Raises
        ------
        SkinMismatchError
            Another number of taxels.
        InvalidArrayError
            NaN or infinity.
        """
        block = check_finite(samples, "samples", (None, None))
        if block.shape[1] != len(self):
            raise SkinMismatchError(f"{block.shape[1]} taxels, calibrated are {len(self)}")
        state = self.track() if tracker is None else tracker
        answer = state.apply(block)
        touched = answer > self.threshold
        if self.gain is None:
            pressure = answer
        else:
            pressure = self.gain.loads(np.maximum(answer, 0.0), state.branch.apply(answer))
        usable = touched & self._fit_to_use()
        if self.thermal is not None:
            usable &= ~self.thermal
        return np.where(usable, pressure, 0.0)

    def _fit_to_use(self) -> BoolArray:
        """Channels (n,) that nothing is known to be wrong with."""
        return np.isin(self.health, (Health.OK, Health.NEVER_TOUCHED))

    def check_skin(self, fingerprint: str) -> None:
        """Refuse another skin than the one calibrated.

        Raises
        ------
        SkinMismatchError
            Both fingerprints are known and differ.
        """
        if self.fingerprint and fingerprint and fingerprint != self.fingerprint:
            raise SkinMismatchError(
                f"calibrated was the skin {self.fingerprint[:12]}, this one is {fingerprint[:12]}"
            )

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        states, counts = np.unique(self.health, return_counts=True)
        return {
            "taxels": len(self),
            "health": ", ".join(f"{n} {state}" for state, n in zip(states, counts, strict=True)),
            "noise": f"{float(np.median(self.noise)):.3g} counts",
            "unit": "counts" if self.gain is None else "load",
        }


def _check_sign(reference: ReferenceLoads, baseline: FloatArray, sign: int) -> None:
    """Refuse a sign where most taxels that are loaded move the other way."""
    loaded = (reference.loads > 0).any(axis=0)
    moved = np.where(reference.loads > 0, reference.samples - baseline, 0.0)
    way, back = (sign * moved).max(axis=0), (-sign * moved).max(axis=0)
    wrong = loaded & (back > 4.0 * MARGIN) & (back > 4.0 * way)
    if wrong.sum() > 0.5 * max(int(loaded.sum()), 1):
        raise InvalidArrayError(
            f"{int(wrong.sum())} of {int(loaded.sum())} loaded channels "
            f"{'fall' if sign > 0 else 'rise'} under load: `sign` must be {-sign}, one number for "
            "all channels"
        )


def restless(rest: FloatArray, baseline: FloatArray, noise: FloatArray) -> BoolArray:
    """Channels (n,) that jump in samples (t, n) at rest: touched, or with bursts of noise."""
    away = np.percentile(np.abs(rest - baseline), 95, axis=0)
    return np.asarray((away > RESTLESS * noise) & (away > 2.0 * MARGIN))


def _check_rest(deviation: FloatArray, moved: BoolArray) -> None:
    """Refuse samples (t, n) off the baseline [counts] of a skin that did not rest."""
    common = float(np.ptp(np.percentile(np.median(deviation, axis=1), (5, 95))))
    if moved.mean() > TOUCHED or common > COMMON:
        raise InvalidArrayError(
            f"rest was touched: {int(moved.sum())} of {len(moved)} channels jump, all together "
            f"by {common:.0f} counts; thresholds from it would miss touches"
        )


def _check_gain(
    gain: Gain, reference: ReferenceLoads, baseline: FloatArray, sign: int, answer: BoolArray
) -> None:
    """Refuse loads that teach no curve, or that do not go with the samples."""
    share = explained(gain, reference, baseline, sign)
    if np.isnan(share).all():
        raise InvalidArrayError("no channel has six samples under load: the reference has no curve")
    share = share[answer & np.isfinite(share)]
    if len(share) and np.median(share) < EXPLAINED:
        late = lag_of(reference, baseline, sign)
        words = f"; the loads come {late:+d} rows after the samples" if abs(late) > 2 else ""
        raise InvalidArrayError(
            f"the loads explain {100 * max(float(np.median(share)), 0):.0f} % of the samples under "
            f"load, {100 * EXPLAINED:.0f} % are needed: rows of both must be "
            f"of one moment, and channels in one order{words}"
        )


def _health(
    rest: FloatArray,
    baseline: FloatArray,
    noise: FloatArray,
    threshold: FloatArray,
    reference: ReferenceLoads | None,
    sign: int,
) -> NDArray[np.str_]:
    still = np.ptp(rest, axis=0) == 0
    # Where harder is lower the range ends below, else above.
    at_end = (baseline <= RANGE[0]) if sign < 0 else (baseline >= RANGE[1])
    state = np.full(len(baseline), Health.NEVER_TOUCHED.value, dtype="<U13")
    if reference is not None:
        loaded = reference.loads > 0
        answer = sign * (reference.samples - baseline)
        largest = np.where(loaded, answer, -np.inf).max(axis=0, initial=-np.inf)
        state[loaded.any(axis=0)] = Health.DEAD
        state[largest > threshold] = Health.OK
    typical = np.median(noise[~still]) if (~still).any() else np.inf
    state[noise > NOISY * typical] = Health.NOISY
    # A skin whose taxels all rest without noise is a quiet simulator, not a dead robot.
    lonely = still & (still.mean() < 0.5)
    state[lonely & (state != Health.DEAD) & (state != Health.OK)] = Health.STUCK
    state[at_end] = Health.SATURATED
    return state


class DriftTracker:
    """Baselines of n channels through a stream of blocks: they follow drift and never a touch.

    A baseline adapts only while its taxel is free. While one is pressed, its baseline moves with
    the common drift of the free channels of its module, as far as its own reading moves along with
    it: warming skins stay calibrated under a hand, and a steady reading is not bent by neighbours
    that drift alone. A touch is over when the reading falls by most of its height at once; what
    then remains and could have drifted while it lasted is drift, and the baseline takes it over.

    Parameters
    ----------
    baseline, threshold : (n,) float
        At the start [counts].
    sign : int
        1 where presses read higher.
    rate : float
        Samples a second.
    modules : (n,) int, optional
        Module of each channel; the whole skin drifts as one where it is not known.
    thermal : (n,) bool, optional
        Channels that feel temperature and no touch: always free, so they tell the drift of a
        module that is pressed all over.
    trusted : (n,) bool, optional
        Channels whose drift may speak for others: a dead one never drifts, a noisy one always.
    """

    def __init__(
        self,
        baseline: FloatArray,
        threshold: FloatArray,
        sign: int,
        rate: float,
        *,
        modules: IntArray | None = None,
        thermal: BoolArray | None = None,
        trusted: BoolArray | None = None,
    ) -> None:
        n = len(baseline)
        self.baseline = baseline.copy()
        self.threshold = threshold
        self.sign, self.rate = sign, rate
        self.branch = BranchFollower(0.5 * threshold)  # which loads fall
        self._tactile = np.ones(n, np.bool_) if thermal is None else ~thermal
        self._trusted = np.ones(n, np.bool_) if trusted is None else trusted
        self._module = np.zeros(n, np.int64)
        if modules is not None:
            self._module = np.unique(modules, return_inverse=True)[1].ravel()
        self._height = np.zeros(n)  # of the present touch [counts]; 0 while free
        self._held = np.zeros(n)  # how long it has lasted [s]
        self._settling = np.zeros(n)  # time left of what follows a release [s]
        self._before = baseline.copy()  # when the touch began
        self._drift = np.zeros(n)  # common drift since then [counts]
        self._sums = np.zeros((5, n))  # of 1, x, y, x x, x y; x the drift, y the reading

    def apply(self, samples: FloatArray) -> FloatArray:
        """Deviations (t, n) from the tracked baselines for the next samples (t, n) [counts]."""
        out = np.empty(samples.shape)
        for row, sample in enumerate(samples):
            out[row] = self._step(sample)
        return out

    def _step(self, sample: FloatArray) -> FloatArray:
        deviation = self.sign * (sample - self.baseline)
        begun = (deviation > self.threshold) & self._tactile & (self._height == 0)
        if begun.any():
            self._before[begun] = self.baseline[begun]
            self._drift[begun] = 0.0
            self._sums[:, begun] = 0.0
            self._height[begun] = deviation[begun]
            self._held[begun] = 0.0
        pressed = self._height > 0
        if pressed.any():
            self._release(sample, deviation, pressed)
            pressed = self._height > 0
        move = self._move(sample)
        if not pressed.any():
            self.baseline += move
        else:
            self._hold(sample, np.flatnonzero(pressed), move, ~pressed)
            self.baseline[~pressed] += move[~pressed]
        return np.asarray(self.sign * (sample - self.baseline))

    def _release(self, sample: FloatArray, deviation: FloatArray, pressed: BoolArray) -> None:
        """End the touches whose reading fell."""
        np.maximum(self._height, deviation, out=self._height, where=pressed)
        self._held[pressed] += 1.0 / self.rate
        own = WALK * self._held  # that the baseline may have drifted meanwhile
        over = pressed & (deviation < RELEASED * self._height)
        over &= deviation < self.threshold + own
        rows = np.flatnonzero(over)
        left = sample[rows] - self.baseline[rows]
        self.baseline[rows] += np.clip(left, -own[rows], own[rows])
        self._height[rows] = 0.0
        self._settling[rows] = np.where(self._held[rows] > LONG, SETTLING, 0.0)

    def _move(self, sample: FloatArray) -> FloatArray:
        """What a free baseline moves in this sample [counts]."""
        dt = 1.0 / self.rate
        move = (dt / FREE) * (sample - self.baseline)
        if self._settling.any():
            move[self._settling > 0] *= min(FREE / SETTLING, FREE / dt)
            np.maximum(self._settling - dt, 0.0, out=self._settling)
        return move

    def _hold(self, sample: FloatArray, held: IntArray, move: FloatArray, free: BoolArray) -> None:
        """Move the baselines of pressed taxels with the drift that they share."""
        self._drift[held] += self._common(move, free)[self._module[held]]
        old = held[self._held[held] > LONG]
        if len(old) == 0:
            return
        x, y = self._drift[old], sample[old] - self._before[old]
        sums = self._sums[:, old] + np.stack([np.ones_like(x), x, y, x * x, x * y])
        self._sums[:, old] = sums
        x_mean, y_mean, xx, xy = sums[1:] / sums[0]
        share = (xy - x_mean * y_mean + RIDGE) / (xx - x_mean**2 + RIDGE)
        self.baseline[old] = self._before[old] + np.clip(share, 0.0, 1.0) * x

    def _common(self, move: FloatArray, free: BoolArray) -> FloatArray:
        """Mean move of the free channels of each module, of the whole skin where they are few."""
        usable = free & self._trusted & (self._settling == 0)
        count = int(self._module.max(initial=0)) + 1
        heavy = np.where(self._tactile, 1.0, FREE_CHANNELS) * usable
        total = np.bincount(self._module, heavy, minlength=count)
        limit = self.threshold / (FREE * self.rate)  # a free reading lies within its threshold
        drawn = np.bincount(self._module, heavy * np.clip(move, -limit, limit), minlength=count)
        everywhere = drawn.sum() / max(float(total.sum()), 1.0)
        return np.where(total >= FREE_CHANNELS, drawn / np.maximum(total, 1.0), everywhere)


FORMAT = "skinmap-response-1"
HEAD = {"sign": int, "rate": float, "fingerprint": str}
ARRAYS = ("baseline", "noise", "threshold", "modules", "thermal")  # the last two perhaps


def save_response(response: ResponseCalibration, path: Path) -> None:
    """Write a response calibration; a failure leaves what was there.

    Parameters
    ----------
    response : ResponseCalibration
    path : Path
        A file ending in .npz.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from pathlib import Path
    >>> from calibration.response import ResponseCalibration, save_response
    >>> rest = np.random.default_rng(0).normal(40.0, 1.0, (100, 12))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_response(ResponseCalibration.fit(rest), Path(folder) / "response.npz")

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    given = {name: getattr(response, name) for name in ARRAYS}
    arrays: dict[str, Any] = {name: own for name, own in given.items() if own is not None}
    head = {name: getattr(response, name) for name in HEAD} | {"health": response.health.tolist()}
    if response.gain is not None:
        arrays |= {"gain_loads": response.gain.knots, "gain_counts": response.gain.counts}
    with staged_file(path) as stage:
        stage.write_bytes(headed({"format": FORMAT, **head}, arrays))


def load_response(path: Path, *, fingerprint: str = "") -> ResponseCalibration:
    """Read what `save_response` wrote, for the skin of a fingerprint where it is given.

    Parameters
    ----------
    path : Path
    fingerprint : str
        Of the skin that it is to be used for; empty where that is not known.

    Returns
    -------
    ResponseCalibration
        As it was saved.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from pathlib import Path
    >>> from calibration.response import ResponseCalibration, load_response, save_response
    >>> rest = np.random.default_rng(0).normal(40.0, 1.0, (100, 12))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_response(ResponseCalibration.fit(rest, rate=100.0), Path(folder) / "r.npz")
    ...     load_response(Path(folder) / "r.npz").rate
    100.0

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or not one of ours.
    SkinMismatchError
        Calibrated was another skin.
    """
    if not path.is_file():
        raise MissingFileError(path, "a response calibration")
    with open_headed(path, FORMAT, "a response calibration") as (head, arrays):
        known: dict[str, Any] = {name: kind(head[name]) for name, kind in HEAD.items()}
        known |= {name: arrays[name] for name in ARRAYS[:3]}
        known |= {name: arrays.get(name) for name in ARRAYS[3:]}
        if "gain_loads" in arrays:
            known["gain"] = Gain(arrays["gain_loads"], arrays["gain_counts"])
        response = ResponseCalibration(**known, health=np.array(head["health"], dtype="<U13"))
    response.check_skin(fingerprint)
    return response
