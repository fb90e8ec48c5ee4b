"""From what the sensors send to pressures: a response calibration, or a baseline of our own."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray
from skinmap.errors import SkinMismatchError
from skinmap.live.joined import JoinedSkin
from skinmap.live.source import StreamInfo

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

    def apply(self, samples: NDArray[Any]) -> FloatArray:
        """Pressures (t, n) [counts] for the next samples (t, n); 0 below the threshold."""
        out = np.empty(samples.shape)
        for row, sample in enumerate(samples):
            out[row] = self._step(np.asarray(sample, np.float32))
        return out

    def _step(self, sample: NDArray[np.float32]) -> NDArray[np.float32]:
        if self._seen >= 0:
            self._listen(sample)
        deviation = self.sign * (sample - self.baseline)
        touched = deviation > self.threshold
        pressed = self._height > 0
        if touched.any() or pressed.any():
            pressed = self._hold(sample, deviation, touched | pressed)
            touched = deviation > self.threshold
        move = (sample - self.baseline) * np.float32(1.0 / (FREE * self._rate))
        move[pressed] = 0.0
        self.baseline += move
        return np.where(touched, np.minimum(deviation, 255.0), np.float32(0.0))

    def _hold(
        self, sample: NDArray[np.float32], deviation: NDArray[np.float32], pressed: BoolArray
    ) -> BoolArray:
        """Keep the baselines of touched channels and end the touches whose reading fell."""
        rows = np.flatnonzero(pressed)
        self._height[rows] = np.maximum(self._height[rows], deviation[rows])
        self._held[rows] += np.float32(1.0 / self._rate)
        own = WALK * self._held[rows]
        over = deviation[rows] < RELEASED * self._height[rows]
        over &= deviation[rows] < self.threshold[rows] + own
        gone, own = rows[over], own[over]
        self.baseline[gone] += np.clip(sample[gone] - self.baseline[gone], -own, own)
        deviation[gone] = self.sign[gone] * (sample[gone] - self.baseline[gone])
        self._height[gone] = self._held[gone] = 0.0
        pressed = pressed.copy()
        pressed[gone] = False
        return pressed

    def _listen(self, sample: NDArray[np.float32]) -> None:
        """Learn the rest of the channels that do not speak yet; done when all do."""
        if self._seen % self._keep == 0:
            self._window[(self._seen // self._keep) % WINDOW] = sample
        self._seen += 1
        if self._seen < WINDOW * self._keep or self._seen % (self._keep * WINDOW // 4):
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

    def apply(self, samples: NDArray[Any]) -> tuple[FloatArray, FloatArray | None]:
        """Pressures (t, N) [counts] and forces (t, N) [N] for samples (t, N) in dense rows.

        Forces are None where no part is calibrated by loads, NaN for parts that are not.
        """
        if not self._raw:
            return np.asarray(samples, np.float64), None
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
    from skinmap.classify.trained_skin import remember

    own = skin.skins[part].skin
    if hasattr(response, "check_skin"):
        response.check_skin(remember(own).fingerprint)
    if hasattr(response, "__len__") and len(response) != len(own):
        raise SkinMismatchError(
            f"the response calibration of {part!r} has {len(response)} channels, "
            f"the skin has {len(own)} taxels"
        )
