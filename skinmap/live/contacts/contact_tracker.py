"""Contacts through time: each keeps its number from birth to end, through motion and flicker.

docs/contacts.md has the rules with their formulas.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.point_surface import SurfaceWalker
from skinmap.live.contacts.named_touch import ContactEvent, Happening
from skinmap.live.contacts.sample_contacts import (
    PARTED,
    PRINT,
    SETTLED,
    Components,
    Cutter,
    Pieces,
    Track,
    measure,
)
from skinmap.live.robot_skin import JoinedSkin
from skinmap.touch.contacts.skin_geometry import ACTIVE

RELEASE = 0.75 * ACTIVE  # a taxel that was active stays so down to here [counts]
SAMPLES = 1.5  # contacts never join or part from one sample to the next, however slow the stream
# What lands as one with a saddle below this share of the lower summit is two; between this and
# `PARTED` a contact stays what it is.
LANDED = 0.5
NEAR = 16e-3  # from a contact: what is smaller than a print there is a piece of it [m]
BRIDGE = 0.1  # a contact that is not felt for so long is over [s]
LOOK = 0.25  # between two looks at a contact for a saddle: it must be there twice [s]
LARGER = 2.0  # times its area is the contact that a piece has broken off
SLOWEST = 0.2  # between samples; what comes later comes after a gap [s]
REACH = 0.025  # a contact that comes back without a taxel in common lies within this [m]
MEASURES = 3.9e-3  # seconds between two measures of a contact: none of it changes quicker
EVENTS = 1000  # that wait to be taken at most


class ContactTracker:
    """Follows the contacts on a skin, sample by sample.

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
        self._cutter = Cutter(skin, self._components)
        self._walker = SurfaceWalker(skin.positions, skin.faces)
        self.tracks: list[Track] = []
        self.events: deque[ContactEvent] = deque(maxlen=EVENTS)
        self.swallowed: dict[int, int] = {}
        self._next = 0
        self.forget()
        self._measured = self._last = float("nan")
        self._settled = SETTLED
        self._apart = False  # whether a piece lies apart from its contact

    def forget(self) -> None:
        """End all contacts: the clock began anew."""
        for track in self.tracks:
            self._tell("end", track, track.seen)
        self.tracks = []
        self._owner: IntArray = np.full(len(self.skin), -1, np.int64)
        self._was: BoolArray = np.zeros(len(self.skin), np.bool_)
        self._cutter.forget()
        self._index: IntArray = np.zeros(0, np.int64)
        self._row = self._index
        self._calm = False

    @property
    def present(self) -> list[Track]:
        """Contacts felt in the last sample, the oldest first."""
        return [track for track in self.tracks if len(track.taxels)]

    def update(self, time: float, pressures: FloatArray) -> None:
        """Take the next sample: pressures (N,) [counts].

        Measures are taken 250 times a second at most, numbers are given in every sample.
        """
        active = pressures > RELEASE
        active &= self._was | (pressures > ACTIVE)
        index = self._components.accompanied(np.flatnonzero(active), pressures)
        self._was = active
        self.swallowed = {}
        period = time - self._last
        if 0.0 < period <= SLOWEST:
            self._settled = self._cutter.settled = max(SETTLED, SAMPLES * period)
        self._last = time
        if len(index) == 0 and not self.tracks:
            self._index, self._row = index, index
            return
        if not (self._calm and np.array_equal(index, self._index)):
            self._row = self._assign(time, index, pressures[index])
            self._index = index
        fresh = any(track.stroke is None for track in self.tracks)
        if fresh or not self._measured <= time < self._measured + MEASURES:
            self._measured = time
            self._measure(time, pressures)
        else:
            for track in self.present:
                track.seen, track.into = time, -1
        self._expire(time)

    def _assign(self, time: float, index: IntArray, pressures: FloatArray) -> IntArray:
        """(k,) row in `tracks` of each active taxel; -1 for a piece that parted just now."""
        row = np.full(len(index), -1, np.int64)
        self._calm = True
        if len(index):
            pieces = Pieces(time, index, pressures, self._components.label(index), row)
            claims, splinters, orphans = claim(pieces, self._owner[index], len(self.tracks))
            for piece, claimants in claims.items():
                inside = np.flatnonzero(pieces.component == piece)
                own = pieces.only(inside)
                if len(claimants) == 1:
                    row[inside] = self._parted(own, claimants[0])
                else:
                    self._calm = False
                    tracks = {number: self.tracks[number] for number in claimants}
                    row[inside] = self._cutter.cut(own, tracks, self._owner[own.index])
            held = row
            if orphans or splinters or self._apart:
                self._place_pieces(pieces, orphans, splinters)
                held = row.copy()
                for piece, parent in splinters.items():
                    held[(pieces.component == piece) & (row < 0)] = parent
            self._own(index, held)
        for number, track in enumerate(self.tracks):
            track.taxels = index[row == number]
        return row

    def _place_pieces(self, pieces: Pieces, orphans: list[int], splinters: dict[int, int]) -> None:
        """Find the contacts of pieces that belong to none or lie apart; `pieces.row` changes."""
        areas = np.bincount(pieces.component, self.skin.areas[pieces.index])
        self._adopt(pieces, [piece for piece in orphans if areas[piece] >= PRINT])
        # Not two new contacts of one finger: each small piece sees those before it.
        for piece in orphans:
            if areas[piece] < PRINT and not self._broken_off(pieces, piece):
                self._adopt(pieces, [piece])
        apart = {
            piece: parent
            for piece, parent in splinters.items()
            if areas[piece] >= PRINT or not self._broken_off(pieces, piece)
        }
        self._part(pieces, apart)
        self._apart = bool(apart)

    def _parted(self, own: Pieces, number: int) -> int | IntArray:
        """Row in `tracks` of the taxels (k,) of one contact, in which a saddle may have settled."""
        time, taxels, track = own.time, own.index, self.tracks[number]
        if time - track.looked < LOOK:
            self._calm &= not track.saddle
            return number
        part = self._cutter.fingers(taxels, own.pressures, PARTED)
        before, track.saddle, track.looked = track.saddle, bool(part.any()), time
        self._calm &= not track.saddle
        if not (before and track.saddle):
            return number
        track.saddle = False
        away = self.skin.positions[taxels] - track.centre
        stays = part[np.einsum("ij,ij->i", away, away).argmin()]
        row = np.full(len(taxels), number)
        for other in np.unique(part[part != stays]).tolist():
            row[part == other] = self._split(time, number, taxels[part == other])
        return row

    def _split(self, time: float, parent: int, taxels: IntArray) -> int:
        """Row of a contact that parts from another one."""
        row = self._begin(time, taxels, self.skin.positions[taxels].mean(axis=0))
        self.tracks[row].touch = self.tracks[parent].touch
        self._tell("split", self.tracks[row], time, self.tracks[parent].identity)
        return row

    def _broken_off(self, pieces: Pieces, piece: int) -> bool:
        """Give a piece smaller than a print to the contact that it lies beside, if any.

        Taxels of little gain break a finger's ridge.
        """
        own, index, row = pieces.component == piece, pieces.index, pieces.row
        held = np.flatnonzero(row >= 0)
        patch = self.skin.patch_of[index]
        held = held[patch[held] == patch[own][0]]
        if len(held) == 0:
            return False
        points = self.skin.positions[index]
        away = points[own][:, None] - points[held]
        gap = np.einsum("abj,abj->ab", away, away).min(axis=0)
        nearest = int(gap.argmin())
        contact = row == row[held[nearest]]
        areas = self.skin.areas[index]
        # Two of like size that land side by side are two.
        if gap[nearest] > NEAR * NEAR or areas[contact].sum() < LARGER * areas[own].sum():
            return False
        row[own] = row[held[nearest]]
        return True

    def _adopt(self, pieces: Pieces, orphans: list[int]) -> None:
        """Give new components to tracks that were lost near them, or to new tracks."""
        if not orphans:
            return
        index, pressures, row = pieces.index, pieces.pressures, pieces.row
        claimed = set(row.tolist())
        lost = [k for k in range(len(self.tracks)) if k not in claimed]
        inside = [pieces.component == piece for piece in orphans]
        points = self.skin.positions[index]
        centres = np.stack([np.average(points[own], 0, pressures[own]) for own in inside])
        patches = [int(self.skin.patch_of[index[own][0]]) for own in inside]
        taken = self._nearest(lost, centres, patches)
        for number, own in enumerate(inside):
            if number in taken:
                row[own] = taken[number]
                continue
            taxels, load = index[own], pressures[own]
            finger = self._cutter.fingers(taxels, load, LANDED)
            for one in range(int(finger.max()) + 1):
                mine = finger == one
                centre = np.average(points[own][mine], 0, load[mine])
                row[np.flatnonzero(own)[mine]] = self._begin(pieces.time, taxels[mine], centre)
                self._tell("birth", self.tracks[-1], pieces.time)

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

    def _part(self, pieces: Pieces, splinters: dict[int, int]) -> None:
        """Pieces that have lain apart from their track for long enough become contacts."""
        for number, track in enumerate(self.tracks):
            if number not in splinters.values():
                track.apart = np.nan
        for piece, parent in splinters.items():
            self._calm = False
            track = self.tracks[parent]
            if np.isnan(track.apart):
                track.apart = pieces.time
            if pieces.time - track.apart >= self._settled:
                own = pieces.component == piece
                pieces.row[own] = self._split(pieces.time, parent, pieces.index[own])

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

    def _measure(self, time: float, pressures: FloatArray) -> None:
        rows = [number for number, track in enumerate(self.tracks) if len(track.taxels)]
        if not rows:
            return
        label = np.full(len(self.tracks), -1)
        label[rows] = np.arange(len(rows))
        index, own = self._index, self._row
        if own.min() < 0:  # pieces that parted just now are nobody's yet
            index, own = index[own >= 0], own[own >= 0]
        found = measure(self.skin, index, label[own], len(rows), pressures[index])
        for place, number in enumerate(rows):
            if self.tracks[number].note(found, place, time, self._walker):
                self._tell("motion", self.tracks[number], time)

    def _expire(self, time: float) -> None:
        """End what has not been felt for too long, or what another contact took in."""
        gone = [
            track
            for track in self.tracks
            if not len(track.taxels) and (track.into >= 0 or time - track.seen > BRIDGE)
        ]
        if not gone:
            return
        kept = [number for number, track in enumerate(self.tracks) if track not in gone]
        place = np.full(len(self.tracks) + 1, -1, np.int64)  # the last for -1
        place[kept] = np.arange(len(kept))
        self._owner = place[self._owner]
        self._row = place[self._row]
        by_identity = {track.identity: track for track in self.tracks}
        for track in gone:
            if track.into >= 0 and track.into in by_identity:
                self._tell("merge", by_identity[track.into], time, track.identity)
                if time - track.began <= 2 * SETTLED:
                    self.swallowed[track.identity] = track.into
            else:
                self._tell("end", track, track.seen)
        self._cutter.forget({track.identity for track in gone})
        self.tracks = [self.tracks[number] for number in kept]

    def _tell(self, kind: Happening, track: Track, time: float, other: int = -1) -> None:
        x, y, z = track.centre.tolist()
        part = self.skin.parts[track.part]
        self.events.append(ContactEvent(kind, track.identity, other, part, time, (x, y, z)))


def claim(
    pieces: Pieces, owner: IntArray, tracks: int
) -> tuple[dict[int, list[int]], dict[int, int], list[int]]:
    """Which tracks each component goes on for, pieces off a track, and new components.

    A track goes on in the component that bears most load on taxels that were its own.
    """
    count = int(pieces.component.max()) + 1
    if tracks == 0:
        return {}, {}, list(range(count))
    key = pieces.component * (tracks + 1) + owner + 1
    shared = np.bincount(key, pieces.pressures, minlength=count * (tracks + 1))
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
