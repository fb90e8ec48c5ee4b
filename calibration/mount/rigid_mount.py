"""Where a rigid patch is mounted: from pairs of its points and places known in other frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import FloatArray, IntArray, check_finite, check_points, freeze
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.geometry.rigid import motion_slopes, rigid_fit, transform_points
from skinmap.summary import Summary, millimetres

Loss = Literal["linear", "cauchy"]
CAUCHY = 2.3849  # residuals' scale: 95 % efficient on normal errors (Holland and Welsch 1977)
LENGTH = 1.5382  # median length of a normal vector in space, in standard deviations
ROUNDS = 200
SETTLED = 1e-9  # relative to the size of the points
RIGID = 1e-6
FLOOR = 1e-12  # of the points' size: residuals below are rounding


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class MountFit(Summary):
    """The pose of a patch on its link, and how well it explains the pairs.

    Attributes
    ----------
    mount : (4, 4) float
        T_link_patch.
    rms : float
        Root mean square distance of the pairs after the fit [m].
    covariance : (6, 6) float
        Of a left-multiplied rotation vector [rad] and the translation [m], in this order.
    residuals : (m,) float
        Distance of each pair [m].
    """

    mount: FloatArray
    rms: float
    covariance: FloatArray
    residuals: FloatArray

    def __post_init__(self) -> None:
        freeze(self)

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "pairs": len(self.residuals),
            "rms": millimetres(self.rms),
            "translation": ", ".join(map(millimetres, self.mount[:3, 3].tolist())),
        }


def fit_mount(
    points: ArrayLike,
    frames: ArrayLike,
    targets: ArrayLike,
    *,
    loss: Loss = "linear",
) -> MountFit:
    """The mount T_link_patch that brings points to their targets: T_world_link @ mount @ point.

    Every target is carried back into its link first, which turns the problem into one of two
    point sets: the least squares mount has a closed form (Kabsch 1976) and no start can miss it.
    The robust loss reweights from there.

    Parameters
    ----------
    points : (m, 3) array-like of float
        In the frame of the patch [m].
    frames : (m, 4, 4) array-like of float
        T_world_link of each pair.
    targets : (m, 3) array-like of float
        In the world [m].
    loss : {"linear", "cauchy"}
        Squares, or a loss that outliers cannot pull.

    Returns
    -------
    MountFit
        T_link_patch (4, 4), its covariance and the distances (m,) that are left [m].

    Raises
    ------
    InvalidArrayError
        Wrong shapes, NaN, frames that are not rigid (names the rows), fewer than three pairs
        or points in a row.

    Examples
    --------
    >>> import numpy as np, skinmap
    >>> points = np.random.default_rng(0).uniform(-0.05, 0.05, (20, 3))
    >>> frames = np.tile(np.eye(4), (20, 1, 1))
    >>> found = skinmap.fit_mount(points, frames, points + [0.1, 0.3, 0.02])
    >>> found.mount[:3, 3].round(3).tolist()
    [0.1, 0.3, 0.02]
    """
    p, back = _check(points, frames, targets)
    if loss not in get_args(Loss):
        raise UnknownNameError("loss", loss, get_args(Loss))
    # Squares first: the robust loss alone loses its way from far starts.
    mount, weight = rigid_fit(p, back, np.ones(len(p))), np.ones(len(p))
    if loss == "cauchy":
        mount, weight = _robust(p, back, mount)
    placed = transform_points(mount, p)
    missed = np.linalg.norm(placed - back, axis=1)
    covariance = _covariance(placed - mount[:3, 3], missed, weight)
    return MountFit(mount, float(np.sqrt(np.mean(missed**2))), covariance, missed)


def _robust(p: FloatArray, q: FloatArray, mount: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mount and weights (m,) of Cauchy's loss by turns, each in closed form."""
    size = max(1.0, float(np.ptp(p, axis=0).max()))
    weight = np.ones(len(p))
    for _ in range(ROUNDS):
        before = mount
        length = np.linalg.norm((q - mount[:3, 3]) @ mount[:3, :3] - p, axis=1)
        # The spread of three coordinates: the median of their length is 1.54 deviations.
        scale = max(float(np.median(length)) / LENGTH, FLOOR * size)
        weight = 1.0 / (1.0 + (length / (CAUCHY * scale)) ** 2)
        mount = rigid_fit(p, q, weight)
        if np.abs(mount - before).max() < SETTLED * size:
            break
    return mount, weight


def _covariance(arms: FloatArray, missed: FloatArray, weight: FloatArray) -> FloatArray:
    """(6, 6) covariance from the residuals' own spread; `arms` (m, 3) from the mount's origin.

    With weights w the residuals r count as (w r)^2 and the slope of w r is their information
    (Huber 1981, section 7.6): honest under outliers, and plain least squares where w is 1.
    """
    jacobian = motion_slopes(arms)
    slope = float(np.mean(weight + 2.0 * weight**2)) / 3.0
    normal = np.einsum("mki,mkj->ij", jacobian, jacobian)
    free = max(1.0, 3.0 * len(arms) - 6.0) / len(arms)
    variance = float(np.mean((weight * missed) ** 2)) / free / slope**2
    return np.asarray(variance * np.linalg.pinv(normal, hermitian=True))


def point_covariance(mount: FloatArray, points: FloatArray, covariance: FloatArray) -> FloatArray:
    """(n, 3, 3) of points (n, 3) of a patch in its link [m2], from that of its mount (6, 6)."""
    jacobian = motion_slopes(points @ mount[:3, :3].T)
    return np.asarray(jacobian @ covariance @ jacobian.transpose(0, 2, 1))


def _check(
    points: ArrayLike, frames: ArrayLike, targets: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Points (m, 3) in the patch and the targets (m, 3) carried back into the link."""
    p = check_points(points, "points")
    q = check_finite(targets, "targets", (len(p), 3))
    T = check_frames(frames, len(p))
    if len(p) < 3:
        raise InvalidArrayError(f"a mount needs at least 3 pairs, got {len(p)}")
    spread = np.linalg.svd(p - p.mean(axis=0), compute_uv=False)
    if spread[1] <= 1e-6 * spread[0]:
        raise InvalidArrayError("all points lie in a row: the patch could turn about it")
    return p, np.einsum("mji,mj->mi", T[:, :3, :3], q - T[:, :3, 3])


def check_frames(frames: ArrayLike, m: int) -> FloatArray:
    """Rigid frames (m, 4, 4).

    Raises
    ------
    InvalidArrayError
        Wrong shape, NaN, or frames that are not rigid (names the rows).
    """
    T = check_finite(frames, "frames", (m, 4, 4))
    turn = T[:, :3, :3]
    off = np.abs(turn @ turn.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) > RIGID
    off |= (np.linalg.det(turn) < 0) | (np.abs(T[:, 3] - [0, 0, 0, 1]).max(axis=1) > RIGID)
    if off.any():
        rows = np.flatnonzero(off)
        raise InvalidArrayError(f"{len(rows)} frames are not rigid: rows {some(rows)}")
    return T


def some(rows: Sequence[int] | IntArray, most: int = 5) -> str:
    """The first few numbers, in words: "3, 7 ..."."""
    return ", ".join(str(int(row)) for row in rows[:most]) + (" ..." if len(rows) > most else "")
