"""Which contacts claim a connected component, and which of its taxels are whose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.live.contacts.followed_contact import SETTLED, Track
from skinmap.live.contacts.sample_contacts import Components, basins
from skinmap.live.robot_skin import JoinedSkin

VALLEY = 0.7  # of the lower summit: contacts with less pressure than this between them are two
LANDED = 0.5  # what lands as one with a saddle below this share of the lower summit is two
PARTED = 0.25  # and so is what was one before: between the two a contact stays as it is
ISLANDS = 0.05  # the same of the islands of one palm, which gains part
GRIP = 0.5  # while a hand closes its islands land [s]
PALM = 1.5e-3  # more than five fingers press: a contact of this size is of a hand [m2]
SPAN = 0.2  # of a hand [m]
CLOSE = 0.015  # a fingertip's width: what lies further apart is two while both have a summit [m]
PRINT = 1.67e-4  # less than the print of a light fingertip: three taxels 8 mm apart [m2]
NEAR = 16e-3  # from a contact: what is smaller than a print there is a piece of it [m]
HIDDEN = 0.5  # a contact without a summit is kept so long [s]


class Cutter:
    """Cuts a component that several contacts claim, along the valleys between them.

    Parameters
    ----------
    skin : JoinedSkin
    components : Components
    """

    def __init__(self, skin: JoinedSkin, components: Components) -> None:
        self._positions, self._normals, self._areas = skin.positions, skin.normals, skin.areas
        self._sheets = skin.patch_of
        self._components = components
        self.settled = SETTLED
        self._meeting: dict[tuple[int, int], float] = {}

    def forget(self, ended: set[int] | None = None) -> None:
        """Forget since when contacts that are over, or all, have met."""
        self._meeting = {
            pair: since
            for pair, since in self._meeting.items()
            if ended is not None and not ended & set(pair)
        }

    def cut(
        self,
        time: float,
        index: IntArray,
        pressures: FloatArray,
        tracks: Sequence[Track],
        claimants: list[int],
        owner: IntArray,
    ) -> IntArray:
        """(k,) track of each taxel of a component that several tracks claim.

        Every summit goes to the track that had it, or to the nearest. Two tracks without a valley
        between them become one: the older goes on.

        Parameters
        ----------
        time : float
            [s].
        index : (k,) int
            Taxels of the component.
        pressures : (k,) float
        tracks : sequence of Track
        claimants : list of int
            Which of the tracks claim it.
        owner : (k,) int
            Track that each taxel was part of, -1 for none.
        """
        beside = self._components.local(index)
        summit = basins(beside, pressures)
        tops = np.unique(summit)
        centres = np.stack([tracks[row].centre for row in claimants])
        away = self._positions[index[tops], None] - centres
        nearest = np.einsum("tcj,tcj->tc", away, away).argmin(axis=1)
        owned = owner[tops]
        goes = np.array(claimants)[nearest]
        goes = np.where(np.isin(owned, claimants), owned, goes)
        row = goes[np.searchsorted(tops, summit)]
        self._keep_flat(time, index, row, tracks, claimants, centres)
        for younger, older in self._joined(time, index, beside, pressures, row, tracks, claimants):
            row[row == younger] = older
            tracks[younger].into = tracks[older].identity
        return row

    def fingers(self, index: IntArray, pressures: FloatArray, depth: float) -> IntArray:
        """(k,) which contact each taxel of one component is part of, 0 where it is a single one.

        Maxima of the pressure by their persistence: regions grow downhill from their summits and,
        where two meet, are one unless the saddle lies below `depth` of the lower summit, the
        summits are a fingertip apart along the skin and each region is as large as a print.
        """
        one = np.zeros(len(index), np.int64)
        areas = self._areas[index]
        total = float(areas.sum())
        if not 2.0 * PRINT <= total <= PALM:
            return one
        beside = self._components.local(index)
        highest = index[int(pressures.argmax())]
        summit = index[pressures >= pressures[beside].max(axis=1)]
        if not (self._along_skin(summit, highest) >= CLOSE).any():
            return one
        tops, region = np.unique(basins(beside, pressures), return_inverse=True)
        size = np.bincount(region, areas).tolist()
        height = pressures[tops].tolist()
        root = list(range(len(tops)))
        sheet = self._sheets[index]
        for saddle, a, b in _saddles(beside, pressures, region):
            # No taxel feels what lies over the joint of two shells: a saddle there must be deeper.
            joint = sheet[tops[a]] != sheet[tops[b]]
            while root[a] != a:
                a = root[a]
            while root[b] != b:
                b = root[b]
            if a == b:
                continue
            high, low = (a, b) if height[a] >= height[b] else (b, a)
            limit = min(depth, PARTED) if joint else depth
            deep = saddle <= limit * height[low] and min(size[a], size[b]) >= PRINT
            if not deep or self._along_skin(index[tops[[a]]], index[tops[b]])[0] < CLOSE:
                root[low] = high
                size[high] += size[low]
        for number, parent in enumerate(root):
            while root[parent] != parent:
                parent = root[parent]
            root[number] = parent
        return np.asarray(np.unique(np.array(root)[region], return_inverse=True)[1])

    def _along_skin(self, some: IntArray, one: int) -> FloatArray:
        """(k,) ways along the skin from some taxels (k,) to one of the same sheet [m].

        Each is the arc of a circle whose ends have their normals: exact on balls and round limbs,
        and as long as the straight line where the skin is flat.
        """
        straight = np.linalg.norm(self._positions[some] - self._positions[one], axis=1)
        half = 0.5 * np.arccos(np.clip(self._normals[some] @ self._normals[one], -1.0, 1.0))
        return np.asarray(straight / np.sinc(half / np.pi))

    def _keep_flat(
        self,
        time: float,
        index: IntArray,
        row: IntArray,
        tracks: Sequence[Track],
        claimants: list[int],
        centres: FloatArray,
    ) -> None:
        """Let contacts live on for a while whose summit is hidden by the gains of the taxels.

        They keep what lies nearest to their centre; not those that landed just now, nor those
        within a finger's width of another.
        """
        for place, number in enumerate(claimants):
            track = tracks[number]
            if (row == number).any():
                track.flat = np.nan
                continue
            track.flat = time if np.isnan(track.flat) else track.flat
            gaps = np.linalg.norm(np.delete(centres, place, axis=0) - centres[place], axis=1)
            landing = time - track.began < self.settled
            if gaps.min() < CLOSE or landing or time - track.flat >= HIDDEN:
                continue
            away = self._positions[index][:, None] - centres
            row[np.einsum("tcj,tcj->tc", away, away).argmin(axis=1) == place] = number

    def _joined(
        self,
        time: float,
        index: IntArray,
        beside: IntArray,
        pressures: FloatArray,
        row: IntArray,
        tracks: Sequence[Track],
        claimants: list[int],
    ) -> list[tuple[int, int]]:
        """Pairs (younger, older) of tracks in one component that are one contact from now on."""
        other = row[beside]
        border = other != row[:, None]
        pass_height = np.minimum(pressures[:, None], pressures[beside])
        joined = []
        by_age = sorted(claimants, key=lambda one: tracks[one].identity)
        palm = float(self._areas[index].sum()) > PALM
        for place, older in enumerate(by_age):
            for younger in by_age[place + 1 :]:
                pair = (tracks[older].identity, tracks[younger].identity)
                if not (row == younger).any() or not (row == older).any():
                    joined.append((younger, older))  # no summit is left of one of them
                    continue
                between = border & (row[:, None] == older) & (other == younger)
                if not between.any():
                    continue
                hand = palm and tracks[younger].began - tracks[older].began <= GRIP
                valley, reach = (ISLANDS, SPAN) if hand else (VALLEY, CLOSE)
                lower = min(pressures[row == older].max(), pressures[row == younger].max())
                if pass_height[between].max() <= valley * lower:
                    self._meeting.pop(pair, None)
                    continue
                since = self._meeting.setdefault(pair, time)
                fresh = time - tracks[younger].began < self.settled
                gap = tracks[younger].centre - tracks[older].centre
                close = float(gap @ gap) < reach * reach
                if fresh or (close and time - since >= self.settled):
                    joined.append((younger, older))
        return joined


def _saddles(
    beside: IntArray, pressures: FloatArray, region: IntArray
) -> list[tuple[float, int, int]]:
    """Passes between neighbouring regions, (pressure, region, region), the highest first."""
    other = region[beside]
    taxel, place = np.nonzero(other > region[:, None])
    height = np.minimum(pressures[taxel], pressures[beside[taxel, place]])
    order = np.argsort(-height, kind="stable")
    taxel, place = taxel[order], place[order]
    a, b = region[taxel].tolist(), other[taxel, place].tolist()
    return list(zip(height[order].tolist(), a, b, strict=True))


def claim(
    component: IntArray, owner: IntArray, pressures: FloatArray, tracks: int
) -> tuple[dict[int, list[int]], dict[int, int], list[int]]:
    """Which tracks each component goes on for, pieces off a track, and new components.

    A track goes on in the component that bears most load on taxels that were its own.
    """
    count = int(component.max()) + 1
    if tracks == 0:
        return {}, {}, list(range(count))
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
