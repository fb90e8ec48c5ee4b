"""Contacts through time: each keeps its number from birth to end, through motion and flicker.

docs/contacts.md has the rules with their formulas.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.surface_path import SurfaceWalker
from skinmap.live.contacts import RELEASE, Components, Measured, basins, measure
from skinmap.live.events import ContactEvent, Happening
from skinmap.live.joined import JoinedSkin
from skinmap.live.strokes import Stroke
from skinmap.touch.contacts import ACTIVE

BRIDGE = 0.1  # a contact that is not felt for so long is over [s]
SETTLED = 0.1  # contacts that join or part do so in earnest after this time [s]
VALLEY = 0.7  # of the lower summit: contacts with less pressure than this between them are two
DRAWING = 0.25  # of its largest load: a contact that leaves draws no way
REACH = 0.025  # a contact that comes back without a taxel in common lies within this [m]
MEASURES = 3.9e-3  # seconds between two measures of a contact: none of it changes quicker
EVENTS = 1000  # that wait to be taken at most


@dataclass(eq=False, slots=True)
class Track:
    """A contact that is followed.

    Attributes
    ----------
    identity, part : int
        Its number, and its part's row.
    began, seen : float
        First sample, and the last one in which it was felt [s].
    taxels : (k,) int
        In the numbering of `JoinedSkin`.
    centre, normal : (3,) float
    area, load, peak, mean, force : float
        As measured last; force is NaN where nobody knows.
    stroke : Stroke
    largest, highest, heaviest : float
        Area, peak and load at their largest.
    touch : int
        Number of the touch that it is part of.
    apart : float
        Since when a piece of it lies apart [s]; NaN where none does.
    into : int
        That took its place without a valley between, -1 else.
    """

    identity: int
    part: int
    began: float
    seen: float
    taxels: IntArray
    centre: FloatArray
    normal: FloatArray
    area: float = 0.0
    load: float = 0.0
    peak: float = 0.0
    mean: float = 0.0
    force: float = float("nan")
    stroke: Stroke | None = None
    largest: float = 0.0
    highest: float = 0.0
    heaviest: float = 0.0
    touch: int = -1
    apart: float = float("nan")
    into: int = -1


class ContactTracker:
    """Follows the contacts on a skin, sample by sample.

    Parameters
    ----------
    skin : JoinedSkin

    Attributes
    ----------
    tracks : list of Track
        All that are not over, those not felt at the moment too.
    events : deque of ContactEvent
        What happened, oldest first; whoever reads takes them out. The oldest of more than a
        thousand are forgotten.
    swallowed : dict of int to int
        Contacts that the last sample showed to be part of another since they began, and which.
    """

    def __init__(self, skin: JoinedSkin) -> None:
        self.skin = skin
        self._components = Components(skin)
        self._walker = SurfaceWalker(skin.positions, skin.faces)
        self.tracks: list[Track] = []
        self.events: deque[ContactEvent] = deque(maxlen=EVENTS)
        self._was: BoolArray = np.zeros(len(skin), np.bool_)
        self._owner: IntArray = np.full(len(skin), -1, np.int64)
        self._index: IntArray = np.zeros(0, np.int64)
        self._row: IntArray = np.zeros(0, np.int64)
        self.swallowed: dict[int, int] = {}
        self._calm = False
        self._meeting: dict[tuple[int, int], float] = {}
        self._next = 0
        self._measured = float("nan")

    @property
    def present(self) -> list[Track]:
        """Contacts felt in the last sample, the oldest first."""
        return [track for track in self.tracks if len(track.taxels)]

    def update(self, time: float, pressures: FloatArray, forces: FloatArray | None = None) -> None:
        """Take the next sample: pressures (N,) [counts] and, where known, forces (N,) [N].

        Measures are taken 250 times a second at most, numbers are given in every sample.
        """
        active = pressures > RELEASE
        active &= self._was | (pressures > ACTIVE)
        index = np.flatnonzero(active)
        self._was = active
        self.swallowed = {}
        if len(index) == 0 and not self.tracks:
            self._index, self._row = index, index
            return
        if not (self._calm and np.array_equal(index, self._index)):
            self._row = self._assign(time, index, pressures[index])
            self._index = index
        fresh = any(track.stroke is None for track in self.tracks)
        if fresh or not self._measured <= time < self._measured + MEASURES:
            self._measured = time
            self._measure(time, pressures, forces)
        else:
            for track in self.tracks:
                if len(track.taxels):
                    track.seen, track.into = time, -1
        self._expire(time)

    def forget(self) -> None:
        """End all contacts: the clock began anew."""
        for track in self.tracks:
            self._tell("end", track, track.seen)
        self.tracks = []
        self._owner.fill(-1)
        self._was.fill(False)
        self._meeting = {}
        self._index = self._row = np.zeros(0, np.int64)
        self._calm = False

    def _assign(self, time: float, index: IntArray, pressures: FloatArray) -> IntArray:
        """(k,) row in `tracks` of each active taxel; -1 for a piece that parted just now."""
        row = np.full(len(index), -1, np.int64)
        self._calm = True
        if len(index):
            component = self._components.label(index)
            claims, splinters, orphans = self._claims(index, component, pressures)
            for piece, claimants in claims.items():
                inside = np.flatnonzero(component == piece)
                if len(claimants) == 1:
                    row[inside] = claimants[0]
                else:
                    self._calm = False
                    row[inside] = self._cut(time, index[inside], pressures[inside], claimants)
            self._adopt(time, orphans, component, index, pressures, row)
            self._part(time, splinters, component, index, row)
            held = row.copy()
            for piece, parent in splinters.items():
                held[(component == piece) & (row < 0)] = parent
            self._own(index, held)
        for number, track in enumerate(self.tracks):
            track.taxels = index[row == number]
        return row

    def _claims(
        self, index: IntArray, component: IntArray, pressures: FloatArray
    ) -> tuple[dict[int, list[int]], dict[int, int], list[int]]:
        """Which tracks each component goes on for, pieces off a track, and new components.

        A track goes on in the component that bears most load on taxels that were its own.
        """
        count, tracks = int(component.max()) + 1, len(self.tracks)
        if tracks == 0:
            return {}, {}, list(range(count))
        owner = self._owner[index]
        key = component * (tracks + 1) + owner + 1
        shared = np.bincount(key, pressures, minlength=count * (tracks + 1))
        shared = shared.reshape(count, tracks + 1)[:, 1:]
        main = np.where(shared.max(axis=0) > 0, shared.argmax(axis=0), -1).tolist()
        claims: dict[int, list[int]] = {}
        for track, piece in enumerate(main):
            if piece >= 0:
                claims.setdefault(piece, []).append(track)
        splinters, orphans = {}, []
        heaviest = shared.max(axis=1).tolist()
        for piece in range(count):
            if piece not in claims:
                if heaviest[piece] > 0:
                    splinters[piece] = int(shared[piece].argmax())
                else:
                    orphans.append(piece)
        return claims, splinters, orphans

    def _cut(
        self, time: float, index: IntArray, pressures: FloatArray, claimants: list[int]
    ) -> IntArray:
        """(k,) track of each taxel of a component that several tracks claim.

        Every summit goes to the track that had it, or to the nearest. Two tracks without a valley
        between them become one: the older goes on.
        """
        beside = self._components.local(index)
        summit = basins(beside, pressures)
        tops = np.unique(summit)
        centres = np.stack([self.tracks[row].centre for row in claimants])
        away = self.skin.positions[index[tops], None] - centres
        nearest = np.einsum("tcj,tcj->tc", away, away).argmin(axis=1)
        owned = self._owner[index[tops]]
        goes = np.array(claimants)[nearest]
        goes = np.where(np.isin(owned, claimants), owned, goes)
        row = goes[np.searchsorted(tops, summit)]
        for younger, older in self._joined(time, beside, pressures, row, claimants):
            row[row == younger] = older
            self.tracks[younger].into = self.tracks[older].identity
        return row

    def _joined(
        self,
        time: float,
        beside: IntArray,
        pressures: FloatArray,
        row: IntArray,
        claimants: list[int],
    ) -> list[tuple[int, int]]:
        """Pairs (younger, older) of tracks in one component that are one contact from now on."""
        other = row[beside]
        border = other != row[:, None]
        pass_height = np.minimum(pressures[:, None], pressures[beside])
        joined = []
        by_age = sorted(claimants, key=lambda one: self.tracks[one].identity)
        for place, older in enumerate(by_age):
            for younger in by_age[place + 1 :]:
                pair = (self.tracks[older].identity, self.tracks[younger].identity)
                if not (row == younger).any() or not (row == older).any():
                    joined.append((younger, older))  # no summit is left of one of them
                    continue
                between = border & (row[:, None] == older) & (other == younger)
                if not between.any():
                    continue
                lower = min(pressures[row == older].max(), pressures[row == younger].max())
                if pass_height[between].max() <= VALLEY * lower:
                    self._meeting.pop(pair, None)
                    continue
                since = self._meeting.setdefault(pair, time)
                fresh = time - self.tracks[younger].began < SETTLED
                if fresh or time - since >= SETTLED:
                    joined.append((younger, older))
        return joined

    def _adopt(
        self,
        time: float,
        orphans: list[int],
        component: IntArray,
        index: IntArray,
        pressures: FloatArray,
        row: IntArray,
    ) -> None:
        """Give new components to tracks that were lost near them, or to new tracks."""
        if not orphans:
            return
        claimed = set(row.tolist())
        lost = [k for k in range(len(self.tracks)) if k not in claimed]
        inside = [component == piece for piece in orphans]
        points = self.skin.positions[index]
        centres = np.stack([np.average(points[own], 0, pressures[own]) for own in inside])
        patches = [int(self.skin.patch_of[index[own][0]]) for own in inside]
        taken = self._nearest(lost, centres, patches)
        for number, own in enumerate(inside):
            if number in taken:
                row[own] = taken[number]
                continue
            row[own] = self._begin(time, index[own], centres[number])
            self._tell("birth", self.tracks[-1], time)

    def _nearest(
        self, lost: Sequence[int], centres: FloatArray, patches: list[int]
    ) -> dict[int, int]:
        """Tracks for new components: the pairs of least total distance, on the same sheet."""
        if not lost:
            return {}
        from scipy.optimize import linear_sum_assignment

        where = np.stack([self.tracks[k].centre for k in lost])
        gap = np.linalg.norm(centres[:, None] - where, axis=2)
        sheet = [self.skin.patch_of[self._last_taxel(k)] for k in lost]
        gap[np.array(patches)[:, None] != np.array(sheet)] = np.inf
        cost = np.where(gap <= REACH, gap, 10.0)
        return {
            int(one): lost[int(other)]
            for one, other in zip(*linear_sum_assignment(cost), strict=True)
            if gap[one, other] <= REACH
        }

    def _last_taxel(self, row: int) -> int:
        own = np.flatnonzero(self._owner == row)
        if len(own):
            return int(own[0])
        centre = self.tracks[row].centre
        same = np.flatnonzero(self.skin.part_of == self.tracks[row].part)
        away = self.skin.positions[same] - centre
        return int(same[np.einsum("ij,ij->i", away, away).argmin()])

    def _part(
        self,
        time: float,
        splinters: dict[int, int],
        component: IntArray,
        index: IntArray,
        row: IntArray,
    ) -> None:
        """Pieces that have lain apart from their track for long enough become contacts."""
        for track in self.tracks:
            if not np.isnan(track.apart):
                track.apart = track.apart if self._row_of(track) in splinters.values() else np.nan
        for piece, parent in splinters.items():
            self._calm = False
            track = self.tracks[parent]
            if np.isnan(track.apart):
                track.apart = time
            if time - track.apart >= SETTLED:
                own = component == piece
                centre = self.skin.positions[index[own]].mean(axis=0)
                row[own] = self._begin(time, index[own], centre)
                self.tracks[-1].touch = track.touch
                self._tell("split", self.tracks[-1], time, track.identity)

    def _row_of(self, track: Track) -> int:
        return self.tracks.index(track)

    def _begin(self, time: float, taxels: IntArray, centre: FloatArray) -> int:
        part = int(self.skin.part_of[taxels[0]])
        self.tracks.append(Track(self._next, part, time, time, taxels, centre, np.zeros(3)))
        self.tracks[-1].touch = self._next
        self._next += 1
        return len(self.tracks) - 1

    def _own(self, index: IntArray, held: IntArray) -> None:
        """Note whose taxels are whose; a track that is not felt keeps its last ones."""
        keep = np.arange(-1, len(self.tracks))  # by row + 1: 0 for nobody's
        keep[np.unique(held) + 1] = -1
        self._owner = keep[self._owner + 1]
        self._owner[index] = held

    def _measure(self, time: float, pressures: FloatArray, forces: FloatArray | None) -> None:
        rows = [number for number, track in enumerate(self.tracks) if len(track.taxels)]
        if not rows:
            return
        label = np.full(len(self.tracks), -1)
        label[rows] = np.arange(len(rows))
        index, own = self._index, self._row
        if own.min() < 0:  # pieces that parted just now are nobody's yet
            index, own = index[own >= 0], own[own >= 0]
        found = measure(
            self.skin,
            index,
            label[own],
            len(rows),
            pressures[index],
            None if forces is None else forces[index],
        )
        for place, number in enumerate(rows):
            self._note(self.tracks[number], found, place, time)

    def _note(self, track: Track, found: Measured, place: int, time: float) -> None:
        """Keep what was measured of one contact."""
        track.seen, track.into = time, -1
        track.centre, track.normal = found.centre[place], found.normal[place]
        track.area, track.load = float(found.area[place]), float(found.load[place])
        track.peak, track.mean = float(found.peak[place]), float(found.mean[place])
        if found.force is not None:
            track.force = float(found.force[place])
        track.largest = max(track.largest, track.area)
        track.highest = max(track.highest, track.peak)
        face = int(found.face[place])
        if track.stroke is None or time - track.began < SETTLED:
            # While it lands the centre goes with what lands next, not with the hand.
            track.stroke = Stroke(self._walker, track.centre, face)
        elif track.load >= DRAWING * track.heaviest and track.stroke.add(track.centre, face):
            self._tell("motion", track, time)
        track.heaviest = max(track.heaviest, track.load)

    def _expire(self, time: float) -> None:
        """End what has not been felt for too long, or what another contact took in."""
        kept: list[int] = []
        gone: list[int] = []
        for number, track in enumerate(self.tracks):
            over = len(track.taxels) == 0 and (track.into >= 0 or time - track.seen > BRIDGE)
            (gone if over else kept).append(number)
        if not gone:
            return
        place = np.full(len(self.tracks) + 1, -1, np.int64)  # the last for -1
        place[kept] = np.arange(len(kept))
        self._owner = place[self._owner]
        self._row = place[self._row]
        by_identity = {track.identity: track for track in self.tracks}
        for number in gone:
            track = self.tracks[number]
            if track.into >= 0 and track.into in by_identity:
                self._tell("merge", by_identity[track.into], time, track.identity)
                if time - track.began <= 2 * SETTLED:
                    self.swallowed[track.identity] = track.into
            else:
                self._tell("end", track, track.seen)
        ended = {self.tracks[number].identity for number in gone}
        self._meeting = {
            pair: since for pair, since in self._meeting.items() if not ended & set(pair)
        }
        self.tracks = [self.tracks[number] for number in kept]

    def _tell(self, kind: Happening, track: Track, time: float, other: int = -1) -> None:
        x, y, z = track.centre.tolist()
        part = self.skin.parts[track.part]
        self.events.append(ContactEvent(kind, track.identity, other, part, time, (x, y, z)))
