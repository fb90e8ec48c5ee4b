"""What of a stream of pressures is a touch: by the rest that each taxel shows by itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import BoolArray, FloatArray
from skinmap.live.response.pressures import REST, WINDOW
from skinmap.live.robot_skin import JoinedSkin
from skinmap.touch.contacts.rest import LOW, Rest, felt, find_rest, usual_rest
from skinmap.touch.contacts.skin_geometry import ACTIVE

FROZEN = (
    1.0  # a taxel that moves by no more than this while it is high has no finger on it [counts]
)
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
        every = (rate if rate > 0 else 50.0) * REST / WINDOW
        self._every = max(1, round(every))
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
