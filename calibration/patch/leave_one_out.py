"""Leave-one-out errors in closed form: each piece of evidence predicted by all the others.

For least squares the fit without one observation follows from the fit with it: with the share h
that an observation has in its own prediction, what it misses by without itself is (I - h)^-1 times
what it misses by (Cook and Weisberg, "Residuals and Influence in Regression", 1982, section 2.2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.patch.sheet_model import Evidence
from skinmap.arrays import BoolArray, FloatArray, freeze

LARGEST_SHARE = 0.999  # of an observation that nothing else controls: its error is unknown


@dataclass(frozen=True, eq=False, slots=True)
class LeftOut:
    """What each anchor or touch misses by where all but it are used.

    Attributes
    ----------
    distance : (k,) float
        From the measured point to the predicted one [m].
    expected : (k,) float
        Root of the mean square that is expected of it: its own error and that of the rest [m].
    misfit : (k,) float
        Mean square of a coordinate over what is expected, of the two along the skin or of all
        three, whichever is larger; about 1 on average, above 6.5 it contradicts. A point on the
        wrong taxel is off along the skin alone: the third coordinate would only add noise.
    """

    distance: FloatArray
    expected: FloatArray
    misfit: FloatArray

    def __post_init__(self) -> None:
        freeze(self)

    @classmethod
    def nothing(cls) -> LeftOut:
        """No evidence at all."""
        return cls(np.zeros(0), np.zeros(0), np.zeros(0))

    def only(self, rows: BoolArray) -> LeftOut:
        """Some of them."""
        return LeftOut(self.distance[rows], self.expected[rows], self.misfit[rows])

    def __len__(self) -> int:
        return len(self.distance)


def leave_one_out(
    joint: FloatArray, evidence: Evidence, missed: FloatArray, normals: FloatArray
) -> LeftOut:
    """Errors of evidence that the rest predicts.

    Parameters
    ----------
    joint : (n, 3, n, 3) float
        Joint covariance of the taxels with all evidence [m2].
    evidence : Evidence
    missed : (k, 3) float
        From each point to the sheet there [m].
    normals : (n, 3) float
        Of the taxels.
    """
    _, weight = evidence.loss(missed)
    own = np.einsum("kn,niml,km->kil", evidence.blend, joint, evidence.blend, optimize=True)
    share, axes = np.linalg.eigh(weight[:, None, None] * own)
    rest = 1.0 / (1.0 - np.clip(share, 0.0, LARGEST_SHARE))
    turned = np.einsum("kji,kj->ki", axes, missed)
    error = rest * turned
    variance = evidence.sigma[:, None] ** 2 + rest * share / weight[:, None]
    whole = (error**2 / variance).sum(axis=1)
    return LeftOut(
        np.asarray(np.linalg.norm(error, axis=1)),
        np.asarray(np.sqrt(variance.sum(axis=1))),
        np.maximum(whole / 3.0, _along(axes, error, variance, evidence.blend @ normals) / 2.0),
    )


def _along(
    axes: FloatArray, error: FloatArray, variance: FloatArray, normals: FloatArray
) -> FloatArray:
    """(k,) squared errors along the skin over what is expected of them, two coordinates each.

    Of the marginal distribution of a normal one: the whole, less the share along the direction
    that is projected out, in the metric of the variance.
    """
    across = np.einsum("kji,kj->ki", axes, normals)
    whole = (error**2 / variance).sum(axis=1)
    inner = (across * error / variance).sum(axis=1)
    return np.asarray(whole - inner**2 / (across**2 / variance).sum(axis=1))
