"""Where a rigid patch is mounted: by places known in other frames, or by forces that touched it.

A force on one small place leaves a line in space: with the force f and the moment m about the
sensor, every point r of it has r x f = m (Del Prete et al., "Skin spatial calibration using
force/torque measurements", IROS 2011). The patch is put where its active taxels lie on their
lines.

Next to the edge of a patch the middle of the active taxels lies further in than the place that was
pressed, which on a bent patch looks like a lift. So the points are drawn in by an unknown share: a
fit is a similarity, and the mount is its rigid part.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from scipy.special import chdtri, fdtri

from skinmap.arrays import BoolArray, FloatArray, Frozen, check_finite, check_points
from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.geometry.rigid import motion_slopes, rigid_fit, rigid_transform, transform_points
from skinmap.summary import Summary, first_few, millimetres

Loss = Literal["linear", "cauchy"]
CAUCHY = 2.3849  # residuals' scale: 95 % efficient on normal errors (Holland and Welsch 1977)
LENGTH = 1.5382  # median length of a normal vector in space, in standard deviations
ROUNDS = 200
SETTLED = 1e-9  # relative to the size of the points
RIGID = 1e-6
FLOOR = 1e-12  # of the points' size: residuals below are rounding


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class MountFit(Frozen, Summary):
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
        # The spread of three coordinates: the median of their length is 1.54 deviations. Six
        # degrees of freedom are fitted, so that residuals of few pairs are shorter than the noise.
        scale = max(float(np.median(length)) / LENGTH / math.sqrt(_free(len(p))), FLOOR * size)
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
    free = 3.0 * len(arms) * _free(len(arms))
    variance = float(np.sum((weight * missed) ** 2)) / free / slope**2
    # Few pairs know their own spread badly: areas of 95 % by Student's distribution.
    wider = 3.0 * fdtri(3, free, 0.95) / chdtri(3, 0.05)
    return np.asarray(wider * variance * np.linalg.pinv(normal, hermitian=True))


def _free(pairs: int) -> float:
    """The share of the coordinates of so many pairs that a mount leaves free."""
    return max(1.0, 3.0 * pairs - 6.0) / (3.0 * pairs)


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
        rows = np.flatnonzero(off).tolist()
        raise InvalidArrayError(f"{len(rows)} frames are not rigid: rows {first_few(rows)}")
    return T


FEWEST = 6  # lines: each tells two numbers of six, and some are never independent
FAR = 3.0  # of a robot's parts from a sensor [m]
LIGHTEST = 0.05  # [N]: lighter forces leave no line
POINT_SIGMA = 3e-3  # where in its active taxels a patch was pressed [m]
MOMENT_SIGMA = 5e-3  # of a six-axis sensor of a robot's arm [N m]
FIRST, PROMISING = 12, 4  # steps from every start, and how many go on
STEPS = 60
FOLDS = 5  # each touch is held out once
STANDING = 1e-10  # a step that moves nothing further is the last [m, rad]
LENGTH_ACROSS = 1.1774  # median length of a normal vector in a plane, in standard deviations
QUARTERS = (0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi)
DRAWN_IN = 0.15  # share by which middles of active taxels may lie nearer to the patch's middle
ELSEWHERE = 5e-3  # fits whose points are this far apart are two [m]
RIVAL = 10.0  # log likelihood by which a second place is as good: touches share their errors
IMAGE = 3.0  # the same of the mirror image, which has most of those errors too
MISFIT = 2.0  # sigmas that the touches may stray by
MIRROR = np.array([-1.0, 1.0, 1.0])


def fit_wrench(
    points: ArrayLike,
    frames: ArrayLike,
    forces: ArrayLike,
    moments: ArrayLike,
    *,
    point_sigma: float = POINT_SIGMA,
    moment_sigma: float = MOMENT_SIGMA,
) -> MountFit:
    """The mount T_link_patch that puts points on the lines of the forces that pressed them.

    Parameters
    ----------
    points : (m, 3) array-like of float
        Middle of the active taxels of each touch, in the frame of the patch [m].
    frames : (m, 4, 4) array-like of float
        T_sensor_link at each touch.
    forces, moments : (m, 3) array-like of float
        What the sensor felt more than untouched, in its frame [N, N m].
    point_sigma : float
        Standard deviation of a point [m].
    moment_sigma : float
        Standard deviation of a moment [N m]: lines of light forces count less.

    Returns
    -------
    MountFit
        `residuals` are the distances from the lines.

    Raises
    ------
    InvalidArrayError
        Wrong shapes, NaN, frames that are not rigid, forces too light for a line (names the
        rows), fewer than six touches, lines that are all parallel.

    Examples
    --------
    >>> import numpy as np, skinmap
    >>> rng = np.random.default_rng(0)
    >>> points, forces = rng.uniform(-0.05, 0.05, (20, 3)), rng.normal(size=(20, 3))
    >>> frames, moments = np.tile(np.eye(4), (20, 1, 1)), np.cross(points + [0.1, 0, 0], forces)
    >>> skinmap.fit_wrench(points, frames, forces, moments).mount[:3, 3].round(3)[0]
    np.float64(0.1)
    """
    return fit_lines(Lines.of(points, frames, forces, moments, point_sigma, moment_sigma))


def fit_lines(lines: Lines) -> MountFit:
    """`fit_wrench` of points and their lines."""
    fit = _minima(lines)[0]
    missed = lines.distances(fit)
    rms = float(np.sqrt(np.mean(missed**2)))
    return MountFit(_rigid(fit, lines.points), rms, lines.covariance(fit), missed)


def wrench_doubts(lines: Lines, skin: FloatArray, reach: float) -> tuple[str, ...]:
    """Reasons to doubt the place that `fit_lines` finds, in words.

    `skin` (n, 3) are the points that count [m]: a fit that puts them within `reach` [m] of the
    place found is no other place.
    """
    points = lines.points
    best, *others = _minima(lines)
    scale = max(lines.scale(best), 1.0)
    image = replace(lines, points=points * MIRROR)
    placed = transform_points(_rigid(best, points), skin)
    tried = [(lines, skin, other, RIVAL, "another place") for other in others]
    tried.append((image, skin * MIRROR, _minima(image)[0], IMAGE, "the mirrored drawing"))
    found = []
    for own, drawn, other, enough, words in tried:
        apart = transform_points(_rigid(other, own.points), drawn) - placed
        far = float(np.median(np.linalg.norm(apart, axis=1)))
        worse = own.cost(other, scale) - lines.cost(best, scale)
        if worse < enough and far > reach:
            how = "better" if worse < 0 else "as well"
            found.append(f"{words} fits {how}, {1e3 * far:.1f} mm away")
    if found:
        found[0] += ": check the side of the drawing, and press aslant and from more sides"
    if scale > MISFIT:
        found.append(
            f"touches miss their lines by {scale:.1f} times what points and moments are known to: "
            "tare the sensor, check units, frames and the order of the rows"
        )
    return tuple(found)


def held_out_error(lines: Lines, rng: np.random.Generator) -> float | None:
    """Root mean square distance [m] of points from their lines under fits that never saw them.

    `rng` chooses who is left out when; None for too few touches.
    """
    fold = rng.permutation(len(lines.points)) % FOLDS
    if len(fold) < 2 * FOLDS:
        return None
    fits = [_minima(lines.only(fold != k))[0] for k in range(FOLDS)]
    missed = [lines.only(fold == k).distances(fit) for k, fit in enumerate(fits)]
    return float(np.sqrt(np.mean(np.concatenate(missed) ** 2)))


@dataclass(frozen=True, eq=False, slots=True)
class Lines:
    """Points (m, 3) of a patch, and the lines of a link that they belong on.

    The lines have directions `along` (m, 3), feet (m, 3) and errors `sigma` (m,) [m].
    """

    points: FloatArray
    along: FloatArray
    foot: FloatArray
    sigma: FloatArray

    @classmethod
    def of(
        cls,
        points: ArrayLike,
        frames: ArrayLike,
        forces: ArrayLike,
        moments: ArrayLike,
        point_sigma: float = POINT_SIGMA,
        moment_sigma: float = MOMENT_SIGMA,
    ) -> Lines:
        """Of what `fit_wrench` was given."""
        p = check_points(points, "points")
        T = check_frames(frames, len(p))
        f = check_finite(forces, "forces", (len(T), 3))
        m = check_finite(moments, "moments", (len(T), 3))
        for name, value in (("point_sigma", point_sigma), ("moment_sigma", moment_sigma)):
            if not (np.isfinite(value) and value > 0):
                raise InvalidArrayError(f"{name} must be above 0, got {value}")
        if len(T) < FEWEST:
            raise InvalidArrayError(f"a mount needs at least {FEWEST} lines, got {len(T)}")
        size = np.linalg.norm(f, axis=1)
        if light := np.flatnonzero(size < LIGHTEST).tolist():
            raise InvalidArrayError(
                f"{len(light)} forces are below {LIGHTEST} N and leave no line: rows "
                f"{first_few(light)}"
            )
        back = T[:, :3, :3].transpose(0, 2, 1)
        foot = np.cross(f, m) / size[:, None] ** 2  # the point of the line next to the sensor
        spans = np.ptp(p, axis=0).max(), np.median(np.linalg.norm(foot, axis=1))
        if max(spans) > FAR:
            raise InvalidArrayError(
                f"points span {spans[0]:.3g} m and forces pass the sensor at {spans[1]:.3g} m, "
                f"{FAR:g} m are the most: points, frames and moments must be of one unit"
            )
        foot = np.einsum("mij,mj->mi", back, foot - T[:, :3, 3])
        along = np.einsum("mij,mj->mi", back, f / size[:, None])
        if np.linalg.svd(along, compute_uv=False)[1] < 1e-3 * np.sqrt(len(along)):
            raise InvalidArrayError("all forces are parallel: the patch could slide along them")
        return cls(p, along, foot, np.hypot(point_sigma, moment_sigma / size))

    def only(self, rows: BoolArray) -> Lines:
        """Some of them."""
        return Lines(self.points[rows], self.along[rows], self.foot[rows], self.sigma[rows])

    def misses(self, fit: FloatArray) -> FloatArray:
        """Vectors (m, 3) from the lines to the points, across the lines [m]."""
        apart = transform_points(fit, self.points) - self.foot
        return np.asarray(apart - self.along * np.sum(self.along * apart, axis=1)[:, None])

    def distances(self, fit: FloatArray) -> FloatArray:
        """(m,) of the points from their lines [m]."""
        return np.asarray(np.linalg.norm(self.misses(fit), axis=1))

    def cost(self, fit: FloatArray, scale: float = 1.0) -> float:
        """Cauchy's loss of a fit as a log likelihood, so that outliers do not choose a minimum.

        `scale` is that of the distances, in sigmas.
        """
        missed = self.distances(fit) / (CAUCHY * scale * self.sigma)
        drawn = np.log(_stretch(fit)) / DRAWN_IN
        return float(0.5 * CAUCHY**2 * np.sum(np.log1p(missed**2)) + 0.5 * drawn**2)

    def scale(self, fit: FloatArray) -> float:
        """Spread of the distances in each direction, in sigmas, by their median."""
        return max(float(np.median(self.distances(fit) / self.sigma)) / LENGTH_ACROSS, 1e-9)

    def weights(self, fit: FloatArray) -> FloatArray:
        """(m,) of Cauchy's loss."""
        missed = self.distances(fit) / self.sigma
        return np.asarray(1.0 / (1.0 + (missed / (CAUCHY * self.scale(fit))) ** 2))

    def jacobian(self, fit: FloatArray) -> FloatArray:
        """(m, 3, 7) of the misses to a left-multiplied rotation vector, shift and log stretch."""
        arms = self.points @ fit[:3, :3].T
        whole = np.concatenate([motion_slopes(arms), arms[:, :, None]], axis=2)
        onto = np.einsum("mi,mij->mj", self.along, whole)
        return np.asarray(whole - self.along[:, :, None] * onto[:, None])

    def covariance(self, fit: FloatArray) -> FloatArray:
        """(6, 6) of the mount, from the misses' own spread as in `rigid_mount`."""
        jacobian, weight = self.jacobian(fit) / self.sigma[:, None, None], self.weights(fit)
        missed = self.distances(fit) / self.sigma
        slope = float(np.mean(weight**2))  # of w r in the two directions across a line
        free = max(1.0, 2.0 * len(missed) - 6.0) / len(missed)
        variance = float(np.mean((weight * missed) ** 2)) / free / slope**2
        normal = np.einsum("mki,mkj->ij", jacobian, jacobian)
        normal[6, 6] += variance / DRAWN_IN**2
        # From a stretch about the origin to one about the middle of the points, which stays.
        own = fit[:3, :3] @ self.points.mean(axis=0)
        onto = np.eye(6, 7)
        onto[3:, :6] = motion_slopes((1.0 - 1.0 / _stretch(fit)) * own[None])[0]
        onto[3:, 6] = own
        return np.asarray(variance * onto @ np.linalg.pinv(normal, hermitian=True) @ onto.T)


def _stretch(fit: FloatArray) -> float:
    """Of a similarity (4, 4): above 1 where the points lie too near to their middle."""
    return float(np.cbrt(np.linalg.det(fit[:3, :3])))


def _rigid(fit: FloatArray, points: FloatArray) -> FloatArray:
    """The mount of a similarity (4, 4), about the middle of the points (m, 3)."""
    turn, middle = fit[:3, :3] / _stretch(fit), points.mean(axis=0)
    return rigid_transform(turn, transform_points(fit, middle[None])[0] - turn @ middle)


def _minima(lines: Lines) -> list[FloatArray]:
    """Similarities (4, 4) of the robust loss that are apart, the best first."""
    first: list[FloatArray] = []
    for end in sorted([_descend(own, lines, FIRST) for own in _starts(lines)], key=lines.cost):
        if len(first) < PROMISING and _apart(end, first, lines):
            first.append(end)
    ends = [_descend(own, lines, STEPS) for own in first]
    ends = [_descend(own, lines, STEPS, robust=True) for own in ends]
    last: list[FloatArray] = []
    for end in sorted(ends, key=lines.cost):
        if _apart(end, last, lines):
            last.append(end)
    return last


def _apart(fit: FloatArray, others: list[FloatArray], lines: Lines) -> bool:
    """Whether a fit puts the points elsewhere than all others."""
    places = [transform_points(one, lines.points) for one in (fit, *others)]
    return all(np.sqrt(3.0 * np.mean((places[0] - own) ** 2)) > ELSEWHERE for own in places[1:])


def _starts(lines: Lines) -> list[FloatArray]:
    """The 24 turns by quarters, each with its best translation, and the linear solution."""
    turns = {
        tuple(np.rint(Rotation.from_euler("xyz", angles).as_matrix()).astype(int).ravel())
        for angles in product(QUARTERS, repeat=3)
    }
    rotations = [np.reshape(turn, (3, 3)).astype(np.float64) for turn in sorted(turns)]
    p, along = lines.points, lines.along
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    # Linear in the nine numbers of a matrix and the translation; a sheet leaves some free.
    design = np.concatenate([np.einsum("mij,mk->mijk", across, p).reshape(-1, 3, 9), across], 2)
    wanted = np.einsum("mij,mj->mi", across, lines.foot)
    free = np.linalg.lstsq(design.reshape(-1, 12), wanted.ravel(), rcond=1e-6)[0]
    left, _, right = np.linalg.svd(free[:9].reshape(3, 3))
    rotations.append(left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right)
    starts = []
    for turn in rotations:
        left_over = wanted - np.einsum("mij,mj->mi", across, p @ turn.T)
        shift = np.linalg.lstsq(across.reshape(-1, 3), left_over.ravel(), rcond=None)[0]
        starts.append(rigid_transform(turn, shift))
    return starts


def _descend(start: FloatArray, lines: Lines, steps: int, *, robust: bool = False) -> FloatArray:
    """Levenberg's damped steps from a start to the minimum near it; only a robust fit stretches."""
    fit, damping, p, count = start.copy(), 1e-3, lines.points, 7 if robust else 6
    reach = max(float(np.linalg.norm(p - p.mean(axis=0), axis=1).max()), 1e-6)
    scale = np.array([1 / reach] * 3 + [1.0] * 3 + [1 / reach])[:count]  # of points by their reach
    weight = 1.0 / lines.sigma**2
    for _ in range(steps):
        missed, drawn = lines.misses(fit), np.log(_stretch(fit))
        if robust:
            weight = lines.weights(fit) / lines.sigma**2
        jacobian = lines.jacobian(fit)[:, :, :count] * scale
        weighted = jacobian * weight[:, None, None]
        normal = np.tensordot(weighted, jacobian, axes=([0, 1], [0, 1]))
        slope = np.tensordot(weighted, missed, axes=([0, 1], [0, 1]))
        before = float(weight @ np.sum(missed**2, axis=1)) + (drawn / DRAWN_IN) ** 2
        if robust:
            normal[6, 6] += (scale[6] / DRAWN_IN) ** 2
            slope[6] += scale[6] * drawn / DRAWN_IN**2
        move = -scale * np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slope)
        turn = Rotation.from_rotvec(move[:3]).as_matrix()
        drawn += move[6] if robust else 0.0
        moved = rigid_transform(turn @ fit[:3, :3], fit[:3, 3] + move[3:6])
        moved[:3, :3] *= np.exp(move[6]) if robust else 1.0
        after = float(weight @ np.sum(lines.misses(moved) ** 2, axis=1)) + (drawn / DRAWN_IN) ** 2
        if after > before:
            damping = min(10.0 * damping, 1e6)
            if damping >= 1e6:
                break
            continue
        fit, damping = moved, max(0.1 * damping, 1e-9)
        if np.abs(move).max() < STANDING:
            break
    return fit
