"""From what the sensors send to pressures: a response calibration, or a baseline of our own.

Files of response calibrations, read through a group of entry points.

A gate tells touches in a stream of pressures from the rest that each taxel shows by itself.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray
from skinmap.errors import InvalidArrayError, SkinMismatchError, UnknownNameError, warn
from skinmap.live.robot_skin import JoinedSkin
from skinmap.live.sources.source import StreamInfo
from skinmap.registry import Registry
from skinmap.skin.skin import Skin, fingerprint
from skinmap.touch.contacts.rest import LOW, Rest, felt, find_rest, usual_rest
from skinmap.touch.contacts.skin_geometry import ACTIVE
from skinmap.touch.prepared_skin import PreparedSkin

REST = 2.0  # seconds in which a taxel must have been calm before it speaks
CALM = 6.0  # counts between the 5th and 95th percentile that count as calm: noise of sd 1.8
MARGIN = 4.0  # counts above the noise at rest that make a touch; as `calibration` has it
WINDOW = 100  # samples of the rest that are kept, whatever the rate
FREE = 2.5  # time constant of a free baseline [s]: a press rises quicker than drift by far
RELEASED = 0.25  # of a touch's height: a fall below it is the end of the touch
PATIENT = 20  # looks, four in a window, after which a channel that was never calm speaks, too
WIDER = 2.0  # times its noise at its calmest: what such a channel must exceed before `MARGIN`
WALK = 0.05  # most that a baseline drifts by itself [counts/s]
SAME_RATE = 0.05  # share by which a stream's rate may differ from that of a calibration
MIDDLE = 128.0  # raw values that rest above it fall under load, as those of the iCub do


@runtime_checkable
class Response(Protocol):
    """A response calibration of one part, `calibration.ResponseCalibration` for one.

    One with `track(rate)` is asked for a tracker first, which goes with every block; its `rate` is
    that of the samples it was made of.
    """

    def apply(self, samples: FloatArray) -> FloatArray:
        """Pressures (t, n) for samples (t, n)."""


Calibration = TypeVar("Calibration")


class PartResponse:
    """Applies a response calibration to a stream of one part.

    Parameters
    ----------
    response : Response
        Of a dataclass with a `gain` the counts are taken: what the same answers without.
    rate : float
        Samples a second of the stream, 0 where unknown.

    Attributes
    ----------
    health : (n,) str
        State of each taxel when it was calibrated; empty where the response does not state it.
    """

    def __init__(self, response: Any, rate: float) -> None:
        gain = getattr(response, "gain", None)
        counts = response if gain is None else dataclasses.replace(response, gain=None)
        self.health = getattr(response, "health", np.zeros(0, np.str_))
        self._response, self._gain = response, gain
        extra = {"tracker": counts.track(rate or None)} if hasattr(counts, "track") else {}
        self._counts = partial(counts.apply, **extra)

    def levels(self, row: int) -> dict[str, float]:
        """Raw value at rest of a taxel, and its mean gain over the loads it was calibrated with."""
        found = {}
        if (baseline := getattr(self._response, "baseline", None)) is not None:
            found["raw at rest"] = float(baseline[row])
        if self._gain is not None:
            curve = self._gain.counts[row, 0]
            gain = float((curve[-1] - curve[0]) / (self._gain.knots[-1] - self._gain.knots[0]))
            found |= {"gain": gain} if gain == gain else {}
        return found

    def apply(self, samples: NDArray[Any]) -> FloatArray:
        """Pressures (t, n) in counts."""
        found = self._counts(np.asarray(samples, np.float64))
        return np.clip(np.asarray(found, np.float64), 0.0, 255.0)


class RestBaseline:
    """Pressures of n raw channels from what they send untouched, without a calibration.

    A taxel speaks once it has been calm for two seconds: its baseline is the median of that
    time, its threshold the 95th percentile of the noise and 4 counts. One that was not calm in
    twelve seconds speaks by the calmest two of them, is less sensitive, and counts as noisy.
    While free, the baseline
    follows the reading; while touched it stands, however long. A touch ends when the reading
    falls below a quarter of its height; what then remains and can have drifted is taken over.

    Parameters
    ----------
    group : (n,) int
        Part of each channel: the sign is found for each part.
    rate : float
        Samples a second.

    Attributes
    ----------
    noisy : (n,) bool
        Channels that were never calm.
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
        self.noisy: BoolArray = np.zeros(n, bool)
        self._looks = self.changes = 0  # at noise, and of which channels speak
        # Of the calmest window so far: the 5th, 50th and 95th percentile of each channel.
        self._calmest = np.full((3, n), [[-np.inf], [0.0], [np.inf]])
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
        if left == 0:
            self._hear(block[start : start + 1])
            self._ask()
            if self._seen < 0:
                return len(block)
            start, left = start + 1, every - 1
        self._hear(block[start : start + left])
        return min(len(block), start + left)

    def _hear(self, block: NDArray[np.float32]) -> None:
        kept = np.arange(-self._seen % self._keep, len(block), self._keep)
        self._window[(self._seen + kept) // self._keep % WINDOW] = block[kept]
        self._seen += len(block)

    def _ask(self) -> None:
        """Let those speak that were calm through the whole window; done when all do."""
        if self._seen < WINDOW * self._keep:
            return
        waiting = np.flatnonzero(~self.ready)
        found = np.percentile(self._window[:, waiting], [5, 50, 95], axis=0)
        for part in np.unique(self._group[waiting]).tolist():
            own = self._group == part
            if not self.sign[own].any():
                self.sign[own] = -1.0 if np.median(found[1, own[waiting]]) > MIDDLE else 1.0
        calmer = np.ptp(found, axis=0) < np.ptp(self._calmest[:, waiting], axis=0)
        self._calmest[:, waiting[calmer]] = found[:, calmer]
        self._looks += 1
        calm = np.ptp(found, axis=0) <= CALM
        rows = waiting if self._looks >= PATIENT else waiting[calm]
        self.noisy[waiting[~calm]] = self._looks >= PATIENT
        low, middle, high = self._calmest[:, rows]
        self.changes += len(rows) > 0
        noise = np.where(self.sign[rows] > 0, high - middle, middle - low)
        self.baseline[rows] = middle
        self.threshold[rows] = noise * np.where(self.noisy[rows], WIDER, 1.0) + MARGIN
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
                check_response(response, skin.skins[part].skin, part)
                _warn_of_rate(response, info.rate, part)
                self._own[part] = PartResponse(response, info.rate)
        free = np.array([part not in self._own for part in skin.parts])
        self._rest = np.flatnonzero(free[skin.part_of])
        self._baseline: RestBaseline | None = None
        if self._raw and len(self._rest):
            self._baseline = RestBaseline(skin.part_of[self._rest], info.rate)

    @property
    def changes(self) -> int:
        """How often what `states` says has changed."""
        return 0 if self._baseline is None else self._baseline.changes

    def states(self) -> dict[str, BoolArray]:
        """(N,) taxels that are `stuck`, `noisy`, `dead` or `unheard`, as far as is known here."""
        names = ("stuck", "noisy", "dead", "unheard")
        found = {name: np.zeros(len(self._skin), bool) for name in names}
        if self._baseline is not None:
            found["noisy"][self._rest] = self._baseline.noisy
            found["unheard"][self._rest] = ~self._baseline.ready
        for part, response in self._own.items():
            for name in names[:3]:
                if len(response.health):
                    found[name][self._skin.slices[part]] = response.health == name
        return found

    def levels(self, row: int) -> dict[str, float]:
        """Raw value at rest of a taxel of the joined skin, and its gain, as far as is known."""
        for part, one in self._own.items():
            rows = self._skin.slices[part]
            if rows.start <= row < rows.stop:
                return one.levels(row - rows.start)
        place = np.flatnonzero(self._rest == row)
        if self._baseline is None or not len(place) or not self._baseline.ready[place[0]]:
            return {}
        return {"raw at rest": float(self._baseline.baseline[place[0]])}

    def apply(self, samples: NDArray[Any]) -> NDArray[Any]:
        """Pressures (t, N) [counts] for samples (t, N) in dense rows."""
        if not self._raw:
            return np.asarray(samples, np.float64)
        if self._baseline is not None and not self._own:
            return self._baseline.apply(samples)
        pressures = np.zeros(samples.shape)
        if self._baseline is not None:
            pressures[:, self._rest] = self._baseline.apply(samples[:, self._rest])
        for part, response in self._own.items():
            rows = self._skin.slices[part]
            pressures[:, rows] = response.apply(samples[:, rows])
        return pressures


def _warn_of_rate(response: Any, rate: float, part: str) -> None:
    calibrated = float(getattr(response, "rate", rate))
    if rate > 0 and abs(rate - calibrated) > SAME_RATE * calibrated:
        warn(
            f"the response of {part!r} was calibrated at {calibrated:g} samples a second, the "
            f"stream has {rate:g}: its noise may differ; calibrate again",
            above=1,
        )


def check_response(response: Any, own: Skin, part: str) -> None:
    """Refuse a calibration of another skin.

    Raises
    ------
    SkinMismatchError
        Its fingerprint or number of taxels is another.
    """
    if hasattr(response, "check_skin"):
        response.check_skin(fingerprint(own))
    if hasattr(response, "__len__") and len(response) != len(own):
        raise SkinMismatchError(
            f"the response calibration of {part!r} has {len(response)} channels, "
            f"the skin has {len(own)} taxels"
        )


# `load(path) -> Response`; `file` is the one of `skinmap calibrate response`.
readers: Registry[Callable[[Path], Response]] = Registry(
    "reader of response calibrations", "skinmap.responses"
)


def by_part(
    specs: Sequence[str],
    skins: Mapping[str, PreparedSkin],
    read: Callable[[Path], Calibration],
    what: str,
) -> Iterator[tuple[str, str, Calibration]]:
    """Part, path and calibration of each "PART=PATH" or "PATH".

    A bare path is of the part whose layout was calibrated, of the only part that there is where
    the file does not say which.

    Raises
    ------
    UnknownNameError
        No such part.
    InvalidArrayError
        A file that does not name its part.
    """
    prints = {fingerprint(skin.skin): part for part, skin in skins.items()}
    only = next(iter(skins)) if len(skins) == 1 else ""
    for spec in specs:
        part, equals, name = spec.partition("=")
        if equals and part not in skins:
            raise UnknownNameError("part to calibrate", part, skins)
        name = name if equals else spec
        one = read(Path(name))
        if not equals:
            own = str(getattr(one, "fingerprint", ""))
            part = prints.get(own, "" if own else only)
        if not part:
            raise InvalidArrayError(
                f"{name} was calibrated on none of {', '.join(skins)}, or does not name its skin; "
                f"give PART={what}"
            )
        yield part, name, one


def load_responses(specs: Sequence[str], skins: Mapping[str, PreparedSkin]) -> dict[str, Response]:
    """Response calibrations by part.

    Parameters
    ----------
    specs : sequence of str
        "FILE", for the part whose layout was calibrated or the only one, or "PART=FILE".
    skins : mapping of str to PreparedSkin
        By part.

    Raises
    ------
    UnknownNameError
        No such part, or nobody reads such files.
    MissingFileError, DataFormatError
        No such file, or no calibration.
    InvalidArrayError
        A file that does not name its part.
    SkinMismatchError
        A calibration of another skin.
    """
    found = {}
    for part, name, one in by_part(specs, skins, lambda path: readers.get("file")(path), "FILE"):
        try:
            check_response(one, skins[part].skin, part)
        except SkinMismatchError as error:
            raise SkinMismatchError(f"{name}: {error}") from None
        found[part] = one
    return found


FROZEN = 1.0  # a taxel that is high and moves by no more than this has no finger on it [counts]
TWICE = 2  # windows in which it must be frozen, or dead
AROUND = 4  # taxels beside one that all are pressed, while it reads nothing: it is dead
NEVER = 5  # windows after which a taxel that was never seen at rest is stuck
FOLLOWED = 0.05  # counts a second that levels follow drift by; no press rises so slowly
STEADY = 1.0  # counts that rest may wander without being followed
TOGETHER = 0.75  # of a part's taxels that move alike in two seconds: warmth, and not a hand
WARMING = 2.5  # counts that most may move by in two seconds: a press is quicker
GAINS = 3.0  # times the common movement that one taxel may move by
CROWD = 12  # taxels of a part that can be so many
SOME = 16  # one taxel of so many stands for the skin where a few are learnt
PRESSED_FLAT = 250.0  # a reading at the end of the range stands still under a finger, too [counts]


class RestGate:
    """Lets touches of a joined skin of N taxels pass, and nothing else.

    Each taxel's levels are learnt in the first two seconds in which it is seen at rest; before,
    they are the usual ones. They follow slow drift while the taxel is free, and any drift that
    most taxels of a part share before one of them is pressed; what is felt above them is less by
    as much. What is high before it was first seen at rest is not a touch: it may hang. A taxel is
    stuck while it stands still above the level of a touch for four seconds, for two if it was never
    seen at rest, or if it is never seen at rest for ten; one reading at rest sets it free. A taxel
    that never read anything is dead where all those beside it were pressed at once, in two windows;
    any reading ends that.

    Parameters
    ----------
    skin : JoinedSkin
    rate : float
        Samples a second, 0 where unknown.
    """

    def __init__(self, skin: JoinedSkin, rate: float) -> None:
        self.skin = skin
        n = len(skin)
        self._every = max(1, round((rate if rate > 0 else 50.0) * REST / WINDOW))
        self._follow = FOLLOWED * WINDOW * self._every / (rate if rate > 0 else 50.0)
        self._window = np.zeros((WINDOW, n), np.float32)
        self._seen = 0
        self._known: BoolArray = np.zeros(n, bool)
        self._high = np.zeros(n, np.int64)  # windows that a taxel has been high without a break
        self._still = np.zeros(n, np.int64)  # and has stood still
        self._mute: BoolArray = np.ones(n, bool)  # stuck, or not seen at rest yet
        self._passed = np.zeros(n, np.int64)  # windows in which only those beside it were pressed
        self.rest = self._learnt = usual_rest(n)
        self._home = np.full(n, np.nan)  # mean of a window at rest, when the levels were learnt
        self._drift = np.zeros(n)  # since then [counts]
        self.changes = 0  # of what `states` says

    def apply(self, pressures: NDArray[Any]) -> NDArray[Any]:
        """The pressures (t, N) [counts] with 0 wherever nothing is touched."""
        found = felt(self._without_mute(pressures), self.rest, self.skin.beside)
        start = -self._seen % self._every
        for row in range(start, len(pressures), self._every):
            place = (self._seen + row) // self._every % WINDOW
            self._window[place] = pressures[row]
            if place == WINDOW - 1:
                self._learn()
        self._seen += len(pressures)
        if self._drift.any():
            lower = np.clip(np.rint(found - self._drift), 1, 255).astype(found.dtype)
            found = np.where(found > 0, lower, found)
        return found

    def states(self) -> dict[str, BoolArray]:
        """(N,) taxels that are `stuck`, `noisy`, `dead`, or `unheard`: not yet seen at rest."""
        stuck = self.rest.stuck
        return {
            "stuck": stuck,
            "dead": self._passed >= TWICE,
            "noisy": self._learnt.noisy & ~stuck,
            "unheard": self._mute & ~stuck,
        }

    def _without_mute(self, pressures: NDArray[Any]) -> NDArray[Any]:
        """The pressures (t, N) with 0 wherever a taxel has not been seen at rest, or is stuck."""
        columns = np.flatnonzero(self._mute)
        if len(columns) == 0:
            return pressures
        low = pressures[:, columns] <= ACTIVE + self._drift[columns]
        free = np.logical_or.accumulate(low, axis=0)
        pressures = np.array(pressures)
        pressures[:, columns] = np.where(free, pressures[:, columns], 0)
        freed = columns[free[-1]] if len(free) else columns[:0]
        if len(freed):
            self._mute[freed] = False
            self._high[freed] = self._still[freed] = 0
            stuck = self.rest.stuck.copy()
            stuck[freed] = False
            self.rest = replace(self.rest, stuck=stuck)
            self.changes += 1
        return pressures

    def _learn(self) -> None:
        """Take what a full window says: levels of taxels seen at rest, and who is stuck."""
        low, high = self._window.min(axis=0), self._window.max(axis=0)
        held = low - self._drift > ACTIVE
        still = held & (high - low <= FROZEN) & (high < PRESSED_FLAT)
        self._high = np.where(held, self._high + 1, 0)
        self._still = np.where(still, self._still + 1, 0)
        stuck = (self._still >= TWICE) | (self._mute & (still | (self._high >= NEVER)))
        self._mute |= stuck
        self._find_dead(high)
        waiting = ~self._known & ~held  # what was high throughout shows no rest
        if waiting.any():
            waiting[::SOME] = True  # for the noise that is usual on this skin
            columns = np.flatnonzero(waiting)
            found = find_rest(self._window[:, columns])
            fresh = ~self._known[columns] & ~found.stuck
            names = "offset", "begins", "goes_on"
            levels = {name: getattr(self._learnt, name).copy() for name in names}
            for name, values in levels.items():
                values[columns[fresh]] = getattr(found, name)[fresh]
            self._learnt = replace(self._learnt, **levels)
            self._known[columns[fresh]] = True
        self.rest = self._followed(self.rest.stuck | stuck, high)
        self.changes += 1

    def _find_dead(self, high: NDArray[np.float32]) -> None:
        """Count the windows (of these largest readings) that passed over taxels without any."""
        self._passed[high > 0.0] = -1  # it reads: never dead
        beside, pressed = self.skin.beside, np.append(high > ACTIVE, True)
        some = (self._passed >= 0) & pressed[beside].all(axis=1)
        rows = np.flatnonzero(some & ((beside < len(high)).sum(axis=1) >= AROUND))
        if len(rows):
            padded = np.pad(self._window > ACTIVE, ((0, 0), (0, 1)), constant_values=True)
            self._passed[rows] += padded[:, beside[rows]].all(axis=2).any(axis=0)

    def _followed(self, stuck: BoolArray, high: NDArray[np.float32]) -> Rest:
        """The levels, moved by the drift of taxels that a full window shows free."""
        free, mean = self._known & (high <= self.rest.goes_on), self._window.mean(axis=0)
        self._home = np.where(free & np.isnan(self._home), mean, self._home)
        away = mean - self._home - self._drift
        low = self._known & (mean <= self.rest.goes_on) & ~stuck
        shared = self._shared(away, low)
        moving = (free & (np.abs(away) > STEADY)) | (low & (shared != 0.0))
        most = np.maximum(self._follow, GAINS * np.abs(shared))[moving]
        self._drift += np.where(low, 0.0, shared)  # pressed taxels get as warm as those beside them
        self._drift[moving] += np.clip(away[moving], -most, most)
        learnt = self._learnt
        return Rest(
            learnt.offset + self._drift,
            np.maximum(ACTIVE, learnt.begins + self._drift),
            np.maximum(LOW, learnt.goes_on + self._drift),
            stuck,
        )

    def _shared(self, away: FloatArray, low: BoolArray) -> FloatArray:
        """(N,) movement of the rest that most taxels of a part share [counts]; 0 without."""
        shared = np.zeros(len(away))
        for rows in self.skin.slices.values():
            known, moved = self._known[rows], away[rows][low[rows]]
            common = float(np.median(moved)) if len(moved) else 0.0
            alike = np.count_nonzero(moved * np.sign(common) > STEADY / 2)
            if abs(common) <= WARMING and alike >= max(CROWD, TOGETHER * np.count_nonzero(known)):
                shared[rows] = np.where(known, common, 0.0)
        return shared
