"""Whether recordings of self-touch agree, which of them contradicts the others, what none can tell.

Each recording is fitted alone first: what it misses by there is all that a fit to several may ask
of it. A fit to all with zeros of joints free must then miss each recording by little more. Where
it does not, recordings are left out in turn; the one without which the rest agree is the one that
contradicts them. A recording that cannot even explain itself needs no others to be told.

What self-touch cannot tell are zeros of joints that equal turns of mounts, and joint moves of
patches. The inverse covariance by the touches alone, without priors, says how well each unknown
would be known if nothing else were. A joint whose zero is lost there is compared with each mount
alone: the share of its effect on the touches that the mount can have just as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np

from calibration.mount.chain_fit import Information
from calibration.mount.pairing import Contacts
from calibration.mount.unknowns import STANDOFF_SIGMA, Unknowns
from skinmap.arrays import FloatArray

# Recordings that agree are missed together by 0.93 to 1.1 times what they are missed by alone (a
# simulated iCub, 3 to 6 recordings of 40 to 150 touches; 1.0 on a real robot), wrong
# ones by 3 to 30 times.
RATIO = 2.0
OTHERS = 2.0  # times what others are missed by alone: more, and the recording contradicts itself
MAX_TRIES = 60  # sets of recordings that are left out in turn, each a fit
SHUFFLED = 0.6  # of what it is missed by with poses in another order: more, and they say nothing
UNTOLD = np.deg2rad(1.0)  # half the prior: a zero known no better comes from the prior
SAME = 0.9  # share of a joint's effect that another unknown has too
TOGETHER = 2.0  # times what two patches are to each other that both are to the rest of the robot
BARELY = 1e-9  # of the diagonal: keeps what no touch tells finite, and large
MOVED = np.deg2rad(10.0)  # range of a joint (5 to 95 %) below which more is asked of it


@dataclass(frozen=True, slots=True)
class Agreement:
    """What was found.

    Attributes
    ----------
    inconsistent : tuple of str
        Recordings that contradict the others, the worst first; all that may be the wrong one
        where that cannot be told; empty where all agree.
    told : bool
        Whether leaving these out makes the rest agree, and nothing else does as well.
    senseless : tuple of str
        Those that contradict themselves: their poses and touches do not belong together.
    strained : tuple of str
        Those that agree with the links and with mounts that were not to be calibrated only if
        zeros of joints were off by more than joints are.
    alone : dict of str to float
        Median distance of each recording under a fit to itself [m].
    """

    inconsistent: tuple[str, ...]
    told: bool
    senseless: tuple[str, ...]
    strained: tuple[str, ...]
    alone: dict[str, float]


@dataclass(frozen=True, eq=False, slots=True)
class Jury:
    """Fits and recordings that are asked.

    Attributes
    ----------
    missed : callable
        Median distance [m] of each of some recordings under one fit to them, and how far the zero
        of any joint is off there, over what it may be.
    shuffled : callable
        Median distance [m] of one recording under a fit to it with its poses in another order.
    shared : callable
        How many unknown mounts and tips two recordings share.
    floor : mapping of str to float
        Misses below which no recording is blamed [m].
    """

    missed: Callable[[Sequence[Contacts]], tuple[dict[str, float], float]]
    shuffled: Callable[[Contacts], float]
    shared: Callable[[Contacts, Contacts], int]
    floor: Mapping[str, float]

    def agreement(self, contacts: Sequence[Contacts]) -> Agreement:
        """Judge some recordings."""
        fits = {_name(one): self.missed([one]) for one in contacts}
        alone = {name: medians[name] for name, (medians, _) in fits.items()}
        strained = tuple(name for name, (_, off) in fits.items() if off > 1.0)
        senseless = tuple(
            _name(one) for one in contacts if alone[_name(one)] > SHUFFLED * self.shuffled(one)
        )
        bounds = {name: self._bound(name, alone) for name in alone}
        wrong = {*senseless, *strained, *(name for name in alone if alone[name] > bounds[name])}
        first = sorted(wrong, key=lambda name: alone[name], reverse=True)
        if len(contacts) > 2:
            named, told = self._blamed(contacts, bounds, first)
        elif first or self._excess(contacts, bounds) > 0.0:
            named, told = tuple(alone), False  # of two, which one is wrong cannot be told
        else:
            named, told = (), True
        return Agreement(named, told, senseless, strained, alone)

    def _blamed(
        self, contacts: Sequence[Contacts], bounds: Mapping[str, float], wrong: list[str]
    ) -> tuple[tuple[str, ...], bool]:
        """Who must go until the rest agree, `wrong` first of all, and whether that is certain.

        The fewest that heal all are taken, and never half of those that are left.
        """
        kept = [one for one in contacts if _name(one) not in wrong]
        if len(kept) < 2:
            return tuple(wrong), False
        if self._excess(kept, bounds) == 0.0:
            return tuple(wrong), True
        for count in range(1, (len(kept) + 1) // 2):
            if comb(len(kept), count) > MAX_TRIES:
                break
            healed = [
                some
                for some in combinations(kept, count)
                if self._excess([one for one in kept if one not in some], bounds) == 0.0
            ]
            if healed:
                likely = self._uncorroborated(kept, healed)
                named = dict.fromkeys(_name(one) for some in likely for one in some)
                return (*wrong, *named), len(likely) == 1
        return (*wrong, *map(_name, kept)), False

    def _uncorroborated(
        self, contacts: Sequence[Contacts], healed: Sequence[Sequence[Contacts]]
    ) -> list[Sequence[Contacts]]:
        """Of several without each of which the rest agree, those that leave most agreement.

        Recordings agree about the unknowns that they share; where they share none, that they do
        not contradict each other says nothing.
        """
        left = []
        for some in healed:
            rest = [one for one in contacts if one not in some]
            left.append(sum(self.shared(one, other) for one, other in combinations(rest, 2)))
        return [some for some, count in zip(healed, left, strict=True) if count == max(left)]

    def _bound(self, name: str, alone: Mapping[str, float]) -> float:
        """What a recording may be missed by [m]."""
        others = [missed for other, missed in alone.items() if other != name]
        own = alone[name]
        if others:
            own = min(own, OTHERS * float(np.median(others)))
        return max(RATIO * own, self.floor[name])

    def _excess(self, contacts: Sequence[Contacts], bounds: Mapping[str, float]) -> float:
        """By how much a fit to some recordings misses more than it may, summed in bounds."""
        missed, off = self.missed(contacts)
        over = [own / bounds[name] - 1.0 for name, own in missed.items()]
        return sum(max(0.0, one) for one in (*over, off - 1.0))


def _name(one: Contacts) -> str:
    return one.recording.name


@dataclass(frozen=True, eq=False, slots=True)
class Unobserved:
    """What the touches do not tell.

    Attributes
    ----------
    joints : dict of int to str
        Columns of joints whose zero is not told, and the chain whose mount (or tip) can have the
        same effect; "" where several together do.
    still : dict of int to float
        Columns of joints that hardly moved, and their range [rad].
    together : dict of (str, str) to float
        Patches that may move together, and by how much (standard deviation) [m].
    standoffs : dict of str to str
        Recordings for which it is not told how far skins stand apart as they touch, and the chain
        that may be lifted instead.
    """

    joints: dict[int, str]
    still: dict[int, float]
    together: dict[tuple[str, str], float]
    standoffs: dict[str, str]


def unobserved(
    contacts: Sequence[Contacts],
    known: Information,
    unknowns: Unknowns,
) -> Unobserved:
    """What the touches of a fit do not tell."""
    columns, evidence = known.columns, known.evidence
    diagonal = np.diag(evidence)
    scale = np.sqrt(np.maximum(diagonal, 1e-12))
    scaled = evidence / np.outer(scale, scale) + BARELY * np.eye(len(scale))
    sd = np.sqrt(np.abs(np.diag(np.linalg.inv(scaled)))) / scale
    joints = {
        joint: _same_effect(evidence, known, unknowns, column)
        for joint, column in columns.joints.items()
        if sd[column] > UNTOLD
    }
    standoffs = {
        name: _same_effect(evidence, known, unknowns, column)
        for name, column in columns.standoffs.items()
        if sd[column] > STANDOFF_SIGMA
    }
    return Unobserved(
        joints, _still(contacts, columns.joints), _together(contacts, known, unknowns), standoffs
    )


def _same_effect(evidence: FloatArray, known: Information, unknowns: Unknowns, column: int) -> str:
    """The chain whose mount or tip alone can do nearly all that one unknown does."""
    best, share = "", SAME
    for name, first in known.columns.chains.items():
        own = np.arange(first, first + (6 if name in unknowns.mounts else 3))
        cross = evidence[own, column]
        if not evidence[column, column] > 0.0:
            continue
        has = cross @ np.linalg.pinv(evidence[np.ix_(own, own)]) @ cross / evidence[column, column]
        if has > share:
            best, share = name, float(has)
    return best


def _still(contacts: Sequence[Contacts], joints: Mapping[int, int]) -> dict[int, float]:
    """Joints that hardly moved over all recordings."""
    angles = np.concatenate([one.recording.angles for one in contacts])
    low, high = np.percentile(angles, [5, 95], axis=0)
    return {k: float(high[k] - low[k]) for k in joints if high[k] - low[k] < MOVED}


def _together(
    contacts: Sequence[Contacts], known: Information, unknowns: Unknowns
) -> dict[tuple[str, str], float]:
    """Pairs of patches known better to each other than to the rest of the robot."""
    count = len(known.noise)
    covariance = known.noise + known.considered
    found = {}
    for pair in combinations(unknowns.mounts, 2):
        met = [one for one in contacts if set(one.recording.chains) == set(pair)]
        if not met:
            continue
        rows = np.concatenate([known.rows[one.recording.name][:, :, :count] for one in met])
        own = [np.zeros(count), np.zeros(count)]
        for mask, name in zip(own, pair, strict=True):
            mask[known.columns.chains[name] : known.columns.chains[name] + 6] = 1.0
        alone = min(_spread(rows * mask, covariance) for mask in own)
        between = _spread(rows * (own[0] + own[1]), covariance)
        if alone > TOGETHER * between:
            found[pair] = alone
    return found


def _spread(rows: FloatArray, covariance: FloatArray) -> float:
    """Root mean square move of the places that met, from a covariance of the unknowns [m]."""
    return float(np.sqrt(np.einsum("mac,cd,mad->m", rows, covariance, rows).mean()))
