"""Which contacts claim a connected component, and which of its taxels are whose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.live.contacts.followed_contact import SETTLED, Track
from skinmap.live.contacts.sample_contacts import Components, basins
from skinmap.live.robot_skin import JoinedSkin

VALLEY = 0.7  # of the lower summit: contacts with less pressure than this between them are two
CLOSE = 0.015  # a fingertip's width: what lies further apart is two while both have a summit [m]
HIDDEN = 0.5  # a contact without a summit is kept so long [s]


class Cutter:
    """Cuts a component that several contacts claim, along the valleys between them.

    Parameters
    ----------
    skin : JoinedSkin
    components : Components
    """

    def __init__(self, skin: JoinedSkin, components: Components) -> None:
        self._positions, self._components = skin.positions, components
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
        for younger, older in self._joined(time, beside, pressures, row, tracks, claimants):
            row[row == younger] = older
            tracks[younger].into = tracks[older].identity
        return row

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
            if gaps.min() < CLOSE or time - track.began < SETTLED or time - track.flat >= HIDDEN:
                continue
            away = self._positions[index][:, None] - centres
            row[np.einsum("tcj,tcj->tc", away, away).argmin(axis=1) == place] = number

    def _joined(
        self,
        time: float,
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
        for place, older in enumerate(by_age):
            for younger in by_age[place + 1 :]:
                pair = (tracks[older].identity, tracks[younger].identity)
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
                fresh = time - tracks[younger].began < SETTLED
                gap = tracks[younger].centre - tracks[older].centre
                close = float(gap @ gap) < CLOSE * CLOSE
                if fresh or (close and time - since >= SETTLED):
                    joined.append((younger, older))
        return joined


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
