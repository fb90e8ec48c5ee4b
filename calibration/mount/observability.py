"""What self-touch cannot tell: zeros of joints that equal turns of mounts, joint moves of patches.

The inverse covariance by the touches alone, without priors, says how well each unknown would be
known if nothing else were. A joint whose zero is lost there is compared with each mount alone: the
share of its effect on the touches that the mount can have just as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calibration.mount.chain_fit import Information
from calibration.mount.pairing import Contacts
from calibration.mount.unknowns import STANDOFF_SIGMA, Unknowns
from skinmap.arrays import FloatArray

UNTOLD = np.deg2rad(1.0)  # half the prior: a zero known no better comes from the prior
SAME = 0.9  # share of a joint's effect that another unknown has too
TOGETHER = 2.0  # times what two patches are to each other that both are to the rest of the robot
BARELY = 1e-9  # of the diagonal: keeps what no touch tells finite, and large
MOVED = np.deg2rad(10.0)  # range of a joint (5 to 95 %) below which more is asked of it


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
