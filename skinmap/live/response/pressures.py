"""From what the sensors send to pressures: a response calibration, or a baseline of our own."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray
from skinmap.errors import SkinMismatchError
from skinmap.live.robot_skin import JoinedSkin
from skinmap.live.sources.source import StreamInfo

REST = 2.0  # seconds in which a taxel must have been calm before it speaks
CALM = 6.0  # counts between the 5th and 95th percentile that count as calm: noise of sd 1.8
MARGIN = 4.0  # counts above the noise at rest that make a touch; as `calibration` has it
WINDOW = 100  # samples of the rest that are kept, whatever the rate
FREE = 2.5  # time constant of a free baseline [s]: a press rises quicker than drift by far
RELEASED = 0.25  # of a touch's height: a fall below it is the end of the touch
WALK = 0.05  # most that a baseline drifts by itself [counts/s]
MIDDLE = 128.0  # raw values that rest above it fall under load, as those of the iCub do


@runtime_checkable
class Response(Protocol):
    """A response calibration of one part, `calibration.ResponseCalibration` for one.

    One with `track()` is asked for a tracker first, which goes with every block.
    """

    def apply(self, samples: FloatArray) -> FloatArray:
        """Pressures (t, n) for samples (t, n)."""


class PartResponse:
    """Applies a response calibration to a stream of one part.

    Parameters
    ----------
    response : Response
        A dataclass with a `gain` answers in loads [N]; counts are the answers of the same without.
    """

    def __init__(self, response: Any) -> None:
        gain = getattr(response, "gain", None)
        counts = response if gain is None else dataclasses.replace(response, gain=None)
        self._counts = _Followed(counts)
        self._loads = None if gain is None else _Followed(response)

    def apply(self, samples: NDArray[Any]) -> tuple[FloatArray, FloatArray | None]:
        """Pressures (t, n) in counts, and loads (t, n) [N] where calibrated."""
        block = np.asarray(samples, np.float64)
        counts = np.clip(self._counts.apply(block), 0.0, 255.0)
        return counts, None if self._loads is None else self._loads.apply(block)


class _Followed:
    """A response with its tracker."""

    def __init__(self, response: Any) -> None:
        self._response = response
        self._extra = {"tracker": response.track()} if hasattr(response, "track") else {}

    def apply(self, block: FloatArray) -> FloatArray:
        return np.asarray(self._response.apply(block, **self._extra), np.float64)


class RestBaseline:
    """Pressures of n raw channels from what they send untouched, without a calibration.

    A taxel speaks once it has been calm for two seconds: its baseline is the median of that
    time, its threshold the 95th percentile of the noise and 4 counts. While free, the baseline
    follows the reading; while touched it stands, however long. A touch ends when the reading
    falls below a quarter of its height; what then remains and can have drifted is taken over.

    Parameters
    ----------
    group : (n,) int
        Part of each channel: the sign is found for each part.
    rate : float
        Samples a second.
    """

    def __init__(self, group: NDArray[np.int64], rate: float) -> None:
        n = len(group)
        self._group = group
        self._rate = rate if rate > 0 else 50.0
        self._keep = max(1, round(REST * self._rate / WINDOW))
        self._window = np.zeros((WINDOW, n), np.float32)
        self._seen = 0
        self.sign = np.zeros(n, np.float32)
        self.baseline = np.zeros(n, np.float32)
        self.threshold = np.full(n, np.inf, np.float32)
        self._height = np.zeros(n, np.float32)
        self._held = np.zeros(n, np.float32)

    @property
    def ready(self) -> BoolArray:
        """(n,) which channels speak."""
        return np.asarray(np.isfinite(self.threshold))

    def apply(self, samples: NDArray[Any]) -> NDArray[np.float32]:
        """Pressures (t, n) [counts] for the next samples (t, n); 0 below the threshold."""
        block = np.asarray(samples, np.float32)
        out = np.zeros(block.shape, np.float32)
        start = 0
        while start < len(block):
            stop = self._listen(block, start)
            self._follow(block[start:stop], out[start:stop])
            start = stop
        return out

    def _follow(self, block: NDArray[np.float32], out: NDArray[np.float32]) -> None:
        """Free channels all samples at once, those that are or may be touched one by one."""
        count, rate = len(block), 1.0 / (FREE * self._rate)
        stay = (1.0 - rate) ** count
        low, high = (block[0], block[0]) if count == 1 else (block.min(axis=0), block.max(axis=0))
        falls = self.sign < 0
        most = np.where(falls, self.baseline - low, high - self.baseline)
        least = np.where(falls, self.baseline - high, low - self.baseline)
        # As far as the baseline can sink under the readings, so much higher they may stand.
        most += np.float32(1.0 - stay) * np.maximum(-least, 0.0)
        rows = np.flatnonzero((most > self.threshold) | (self._height > 0))
        touched = None
        if len(rows):
            touched = self._step_through(block[:, rows], rows, out)
        weights = (rate * (1.0 - rate) ** np.arange(count - 1, -1, -1)).astype(np.float32)
        self.baseline *= np.float32(stay)
        self.baseline += weights @ block
        if touched is not None:
            self.baseline[rows] = touched

    def _step_through(
        self, block: NDArray[np.float32], rows: NDArray[np.int64], out: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Work through samples (t, k) of some channels; their baselines (k,) afterwards."""
        baseline, sign, threshold = self.baseline[rows], self.sign[rows], self.threshold[rows]
        height, held = self._height[rows], self._held[rows]
        period, rate = np.float32(1.0 / self._rate), np.float32(1.0 / (FREE * self._rate))
        found = np.zeros(block.shape, np.float32)
        for row, sample in enumerate(block):
            deviation = sign * (sample - baseline)
            pressed = (deviation > threshold) | (height > 0)
            height = np.where(pressed, np.maximum(height, deviation), height)
            held += period * pressed
            own = np.float32(WALK) * held
            over = pressed & (deviation < RELEASED * height) & (deviation < threshold + own)
            if over.any():  # a touch is over: what remains and can have drifted is taken over
                baseline += np.where(over, np.clip(sample - baseline, -own, own), 0.0)
                deviation = sign * (sample - baseline)
                height[over] = held[over] = 0.0
                pressed &= ~over
            found[row] = np.where(deviation > threshold, np.minimum(deviation, 255.0), 0.0)
            baseline += np.where(pressed, 0.0, rate * (sample - baseline))
        out[:, rows] = found
        self._height[rows], self._held[rows] = height, held
        return np.asarray(baseline)

    def _listen(self, block: NDArray[np.float32], start: int) -> int:
        """Hear the rest of channels that do not speak yet; the row up to which nothing changes.

        Whether a channel was calm is asked four times in a window, before the sample is used.
        """
        if self._seen < 0:
            return len(block)
        every = self._keep * WINDOW // 4
        left = every - 1 - self._seen % every  # samples before the next question
        stop = min(len(block), start + left) if left else min(len(block), start + every)
        numbers = np.arange(self._seen, self._seen + stop - start)
        kept = np.flatnonzero(numbers % self._keep == 0)
        if left == 0:
            self._hear(block[start], self._seen)
            self._seen += 1
            self._ask()
            if self._seen < 0:
                return len(block)
            kept = kept[kept > 0]
            self._seen += stop - start - 1
        else:
            self._seen += stop - start
        for row in kept.tolist():
            self._hear(block[start + row], int(numbers[row]))
        return stop

    def _hear(self, sample: NDArray[np.float32], number: int) -> None:
        if number % self._keep == 0:
            self._window[(number // self._keep) % WINDOW] = sample

    def _ask(self) -> None:
        """Let those speak that were calm through the whole window; done when all do."""
        if self._seen < WINDOW * self._keep:
            return
        waiting = np.flatnonzero(~self.ready)
        low, middle, high = np.percentile(self._window[:, waiting], [5, 50, 95], axis=0)
        calm = high - low <= CALM
        rows = waiting[calm]
        self.baseline[rows] = middle[calm]
        for part in np.unique(self._group[waiting]).tolist():
            own = self._group == part
            of_part = middle[own[waiting]]
            if not self.sign[own].any():
                self.sign[own] = -1.0 if np.median(of_part) > MIDDLE else 1.0
        noise = np.where(self.sign[rows] > 0, high[calm] - middle[calm], middle[calm] - low[calm])
        self.threshold[rows] = noise + MARGIN
        if self.ready.all():
            self._seen = -1
            self._window = self._window[:0]


class Responses:
    """Pressures of the whole skin for blocks of samples: each part by what it has.

    Parameters
    ----------
    skin : JoinedSkin
    info : StreamInfo
        Pressures pass; raw values go through a calibration where the part has one.
    responses : mapping of str to Response, optional
        By part.

    Raises
    ------
    SkinMismatchError
        A calibration of another skin, or of another number of taxels.
    """

    def __init__(
        self, skin: JoinedSkin, info: StreamInfo, responses: Mapping[str, Response] | None = None
    ) -> None:
        self._skin = skin
        self._raw = info.kind == "raw"
        self._own: dict[str, PartResponse] = {}
        for part, response in (responses or {}).items():
            if part in skin.slices and self._raw:
                check_response(response, skin, part)
                self._own[part] = PartResponse(response)
        rest = [skin.slices[part] for part in skin.parts if part not in self._own]
        self._rest = np.concatenate(
            [np.zeros(0, np.int64), *(np.arange(rows.start, rows.stop) for rows in rest)]
        )
        self._baseline: RestBaseline | None = None
        if self._raw and len(self._rest):
            self._baseline = RestBaseline(skin.part_of[self._rest], info.rate)

    def apply(self, samples: NDArray[Any]) -> tuple[NDArray[Any], FloatArray | None]:
        """Pressures (t, N) [counts] and forces (t, N) [N] for samples (t, N) in dense rows.

        Forces are None where no part is calibrated by loads, NaN for parts that are not.
        """
        if not self._raw:
            return np.asarray(samples, np.float64), None
        if self._baseline is not None and not self._own:
            return self._baseline.apply(samples), None
        pressures = np.zeros(samples.shape)
        forces: FloatArray | None = None
        if self._baseline is not None:
            pressures[:, self._rest] = self._baseline.apply(samples[:, self._rest])
        for part, response in self._own.items():
            rows = self._skin.slices[part]
            pressures[:, rows], loads = response.apply(samples[:, rows])
            if loads is not None:
                if forces is None:
                    forces = np.full(samples.shape, np.nan)
                forces[:, rows] = loads
        return pressures, forces


def check_response(response: Any, skin: JoinedSkin, part: str) -> None:
    """Refuse a calibration of another skin.

    Raises
    ------
    SkinMismatchError
        Its fingerprint or number of taxels is another.
    """
    from skinmap.skin.fingerprint import fingerprint

    own = skin.skins[part].skin
    if hasattr(response, "check_skin"):
        response.check_skin(fingerprint(own))
    if hasattr(response, "__len__") and len(response) != len(own):
        raise SkinMismatchError(
            f"the response calibration of {part!r} has {len(response)} channels, "
            f"the skin has {len(own)} taxels"
        )
