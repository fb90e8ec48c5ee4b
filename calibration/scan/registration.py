"""A 3D scan of a covered link, registered to the link's mesh.

Iterative closest points for a scan: staged through Open3D, then polished on the mesh itself. What
covers the link lifts the scan off the mesh by a standoff, one length along the normals, which is
fitted with the pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from calibration.patch.link_surface import OFFSET, Target, make_target
from calibration.patch.patch_calibration import Status
from calibration.patch.patch_evidence import IN_A_ROW, check_link, in_a_row, mixed_units
from skinmap.arrays import FloatArray, Frozen, check_points
from skinmap.errors import InvalidArrayError
from skinmap.geometry.rigid import (
    motion_slopes,
    rigid_fit,
    rigid_transform,
    transform_points,
    turn_about,
)
from skinmap.geometry.triangles import face_areas, unit
from skinmap.imports import import_optional
from skinmap.summary import Summary, listed, millimetres

STAGES = (20e-3, 10e-3, 4e-3)  # longest correspondences [m]: first squares, then Tukey's loss
STEPS = 40  # a stage at most
SAMPLES = 15_000  # points of the mesh that Open3D sees
WIDTH = 3e-3  # beyond which Tukey's loss no longer sees a point [m]
FEW = 600  # points of a scan that look for other poses
POLISH = 24  # steps on the mesh itself, half of them with a wider loss: the standoff comes late
WIDER = 3.0  # times WIDTH
COVERED = 0.5e-3  # a standoff below is none: round edges and stray points make as much [m]
COVER_SIGMA = 4e-3  # of the standoff: what covers links is millimetres thick [m]
ROUNDING = 1e-7  # of the pose handed over: what Open3D's threads add up in another order


@dataclass(eq=False)
class Scene:
    """A scan (m, 3) [m], the target it goes on, and both as Open3D holds them."""

    target: Target
    scan: FloatArray
    _source: Any
    _few: Any
    _surface: Any

    def heights(self, pose: FloatArray, standoff: float) -> FloatArray:
        """(m,) signed distance of the scan from where it stands off the mesh [m].

        The wrap stands off by OFFSET.
        """
        points = transform_points(pose, self.scan)
        close, normals = self.target.project(points)
        step = points - close
        high = np.einsum("md,md->m", step, normals) + OFFSET - standoff
        # Off an edge or far away the distance is what counts, not the part along the normal.
        return np.where(np.abs(high) < WIDTH, high, np.linalg.norm(step, axis=1))

    def cost(self, pose: FloatArray, standoff: float = 0.0) -> float:
        """Mean of Tukey's loss [m2]."""
        inside = np.clip(1.0 - (self.heights(pose, standoff) / WIDTH) ** 2, 0.0, 1.0)
        return float((WIDTH**2 / 6.0 * (1.0 - inside**3)).mean())

    def apart(self, one: FloatArray, other: FloatArray) -> float:
        """Root mean square distance between the scan's points in two poses [m]."""
        step = transform_points(one, self.scan) - transform_points(other, self.scan)
        return float(np.sqrt((step**2).sum(axis=1).mean()))


def make_scene(target: Target, scan: FloatArray, rng: np.random.Generator) -> Scene:
    """Ready a scan for registration.

    Raises
    ------
    MissingLibraryError
        Open3D is not installed.
    """
    open3d = import_optional(
        "open3d",
        "scans are registered by Open3D, which is not installed: pip install 'skinmap[scan]'",
    )
    area = face_areas(target.vertices, target.faces)
    face = rng.choice(len(area), SAMPLES, p=area / area.sum())
    weights = rng.dirichlet([1.0, 1.0, 1.0], SAMPLES)
    corners = target.faces[face]
    normals = unit(np.einsum("sc,scd->sd", weights, target.normals[corners]))
    places = np.einsum("sc,scd->sd", weights, target.vertices[corners]) - OFFSET * normals
    surface, source, few = (open3d.geometry.PointCloud() for _ in range(3))
    surface.points = open3d.utility.Vector3dVector(places)
    surface.normals = open3d.utility.Vector3dVector(normals)
    source.points = open3d.utility.Vector3dVector(scan)
    few.points = open3d.utility.Vector3dVector(scan[:: max(1, len(scan) // FEW)])
    return Scene(target, scan, source, few, surface)


def register(scene: Scene, start: FloatArray, *, roughly: bool = False) -> FloatArray:
    """The pose (4, 4) that point-to-plane steps lead to from a start, `roughly` by few points."""
    from open3d.pipelines import registration as o3d

    pose = start
    criteria = o3d.ICPConvergenceCriteria(1e-5, 1e-5, STEPS)
    source = scene._few if roughly else scene._source
    kernels: list[Any] = [()] * len(STAGES) + [(o3d.TukeyLoss(k=WIDTH),)]
    for reach, kernel in zip((*STAGES, STAGES[-1]), kernels, strict=True):
        plane = o3d.TransformationEstimationPointToPlane(*kernel)
        found = o3d.registration_icp(source, scene._surface, reach, pose, plane, criteria)
        pose = found.transformation
    return np.asarray(pose)


def polish(scene: Scene, pose: FloatArray) -> tuple[FloatArray, float]:
    """The pose on the mesh itself, not on samples of it, and the standoff [m]: 0 of a bare link."""
    found = _stepped(scene, _rounded(pose), 7)
    return found if abs(found[1]) > COVERED else _stepped(scene, found[0], 6)


def _stepped(scene: Scene, pose: FloatArray, count: int) -> tuple[FloatArray, float]:
    """Gauss and Newton's steps with Tukey's weights, of the pose (6) and the standoff (7)."""
    standoff, expected = 0.0, (NOISE / COVER_SIGMA) ** 2
    for number in range(POLISH):
        width = WIDTH * (WIDER if count > 6 and 2 * number < POLISH else 1.0)
        rows, high, weight, middle = linearised(scene, pose, standoff, width)
        rows = rows[:, :count]
        normal = (rows * weight[:, None]).T @ rows + 1e-9 * len(rows) * np.eye(count)
        slope = (rows * weight[:, None]).T @ high
        normal[6:, 6:] += expected
        slope[6:] += expected * standoff
        step = np.asarray(np.linalg.solve(normal, -slope), np.float64)
        pose, standoff = _moved(pose, middle, step[:6]), standoff + float(step[6:].sum())
        if width == WIDTH and np.abs(step).max() < 1e-9:
            break
    return pose, standoff


def linearised(
    scene: Scene, pose: FloatArray, standoff: float, width: float = WIDTH
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Derivatives (m, 8), heights (m,) [m], weights (m,) and the point (3,) turned about [m].

    Unknowns: a rotation vector [rad] about the scan's middle, a shift [m], the standoff [m] and
    the logarithm of the scan's size.
    """
    points = transform_points(pose, scene.scan)
    close, normals = scene.target.project(points)
    high = np.einsum("md,md->m", points - close, normals) + OFFSET - standoff
    far = np.linalg.norm(points - close, axis=1) > width + abs(standoff)
    weight = np.where(far, 0.0, np.maximum(1.0 - (high / width) ** 2, 0.0) ** 2)
    middle = points.mean(axis=0)
    arm = points - middle
    grown = np.einsum("md,md->m", arm, normals)
    turned = np.cross(arm, normals)
    rows = np.column_stack([turned, normals, np.full(len(arm), -1.0), grown])
    return rows, high, weight, middle


def _rounded(pose: FloatArray) -> FloatArray:
    turn = Rotation.from_matrix(pose[:3, :3]).as_rotvec()
    turn, shift = (np.round(own / ROUNDING) * ROUNDING for own in (turn, pose[:3, 3]))
    return rigid_transform(Rotation.from_rotvec(turn).as_matrix(), shift)


def _moved(pose: FloatArray, middle: FloatArray, step: FloatArray) -> FloatArray:
    """A pose after a turn (a rotation vector [rad]) about a point, and a shift [m]: (6,)."""
    return turn_about(middle, Rotation.from_rotvec(step[:3]).as_matrix(), step[3:]) @ pose


FEWEST_POINTS = 100
MAX_POINTS = 3000  # of a scan: more only cost time, the noise is far below a millimetre by then
SIZE = (0.1, 2.5)  # of a scan against the mesh, longest extents
TRIES = 6  # starts around the given one
TURN, SHIFT = np.radians(30.0), 25e-3  # how far around [rad, m]
APART = 2e-3  # poses whose points are this far apart are two [m]
RIVAL = 1.02  # a second pose of at most this many times the cost is as good
ON_MESH = 0.5  # share of the scan that has to lie on the mesh
NEAR = 3e-3  # what lies on it [m]
NOISE = 0.5e-3  # the least that a scan strays by [m]
MOVED = 5e-3  # a motion is free if moving this far [m] ...
RAISED = 0.06  # ... raises the mean square of the distances by less than this share
PURE = 0.05  # of a motion's turning part: less is a shift
WORDS = ("long axis", "middle axis", "short axis")
ASTRAY = 10e-3  # of an anchor that was picked by hand [m]
TOLD = 1e-3  # to which the standoff has to be known [m]
ROUNDS = 6  # steps to the size of a scan
SIZED, SURE = 0.025, 5.0  # share by which a scan is too large, and in standard deviations


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class ScanRegistration(Frozen, Summary):
    """Pose of a scan on a mesh.

    Attributes
    ----------
    T_mesh_scan : (4, 4) float
        Takes points of the scan to the frame of the mesh.
    status : Status
        `ok`, `ambiguous` where another pose fits as well, `unobservable` where the shape leaves
        a motion free.
    reasons : tuple of str
        Why, in words.
    free_directions : tuple of str
        The motions that the shape leaves free, in words.
    rms : float
        Distance of the scan from the mesh once it stands off, of what lies on it [m].
    standoff, standoff_sd : float
        Length along the normals by which the scan lies above the mesh, as where a skin covers the
        link, and its standard deviation [m].
    share : float
        Of the scan's points that lie on the mesh.
    covariance : (6, 6) float
        Of a small rotation [rad] about the scan's middle, then of its shift [m].
    runner_up : (4, 4) float or None
        The best other pose that was found.
    runner_up_cost : float
        Its cost over that of the pose taken; inf where there is none.
    """

    T_mesh_scan: FloatArray
    status: Status
    reasons: tuple[str, ...]
    free_directions: tuple[str, ...]
    rms: float
    standoff: float
    standoff_sd: float
    share: float
    covariance: FloatArray
    runner_up: FloatArray | None
    runner_up_cost: float

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "status": self.status.value,
            "rms": millimetres(self.rms),
            "standoff": millimetres(self.standoff),
            "share_on_mesh": f"{self.share:.2f}",
            "reasons": listed(self.reasons),
        }


def register_scan(
    points: ArrayLike,
    vertices: ArrayLike,
    faces: ArrayLike,
    *,
    anchors: tuple[ArrayLike, ArrayLike] | None = None,
    rng: np.random.Generator | int,
) -> ScanRegistration:
    """Register the points of a scan to a link's mesh, from a rough pose.

    No method finds the pose from anywhere dependably, so a start within 30 degrees and 30 mm is
    needed: three or more `anchors`; without them, the frames are taken as equal.

    Parameters
    ----------
    points : (m, 3) array-like of float
        The scan [m].
    vertices, faces : (v, 3) array-like of float, (f, 3) array-like of int
        The link's mesh [m].
    anchors : tuple of two (k, 3) array-like of float, optional
        Points of the scan and the same on the mesh [m].
    rng : numpy.random.Generator or int
        Chooses among the scan's points, and the starts that look for a second pose; a number is
        its seed.

    Returns
    -------
    ScanRegistration
        T_mesh_scan (4, 4), its covariance, and whether it is to be doubted: another pose fits as
        well, anchors are astray, the scan has another size.

    Raises
    ------
    InvalidArrayError
        NaN, too few points, anchors in a row, a scan of another unit (names the factor).
    InvalidMeshError
        An empty mesh.
    MissingLibraryError
        Open3D is not installed (extra `scan`).

    Examples
    --------
    >>> import skinmap
    >>> link = skinmap.load_robot("kaspar").mesh("left_hand")
    >>> scan = link.vertices + [0.01, 0.0, 0.0]
    >>> found = skinmap.register_scan(scan, link.vertices, link.faces, rng=0)
    >>> round(1e3 * float(found.T_mesh_scan[0, 3]))
    -10
    """
    rng = np.random.default_rng(rng)
    scan = check_points(points, "points")
    link = check_link(vertices, faces)
    _check_scan(scan, link[0])
    start = _start(anchors)
    if len(scan) > MAX_POINTS:
        scan = scan[np.sort(rng.choice(len(scan), MAX_POINTS, replace=False))]
    scene = make_scene(make_target(*link), scan, rng)
    poses = [register(scene, start)]
    poses += [register(scene, pose, roughly=True) for pose in _starts(start, scan, rng)]
    best, *others = _distinct(poses, scene)
    astray = () if anchors is None else _astray(best[0], *anchors)
    return _judged(scene, best, others[0] if others else None, astray)


def _check_scan(scan: FloatArray, vertices: FloatArray) -> None:
    if len(scan) < FEWEST_POINTS:
        raise InvalidArrayError(f"a scan needs at least {FEWEST_POINTS} points, got {len(scan)}")
    # Percentiles: a scan may hold a few points of the wall behind.
    size = float(np.linalg.norm(np.subtract(*np.percentile(scan, [99, 1], axis=0))))
    ratio = size / max(float(np.linalg.norm(np.ptp(vertices, axis=0))), 1e-12)
    if SIZE[0] <= ratio <= SIZE[1]:
        return
    words = f"the scan is {ratio:.3g} times as large as the mesh"
    mixed = mixed_units(ratio, SIZE, "scan", "mesh")
    raise InvalidArrayError(f"{words}: {mixed or 'another link, or another unit'}")


def _start(anchors: tuple[ArrayLike, ArrayLike] | None) -> FloatArray:
    if anchors is None:
        return np.eye(4)
    here, there = (
        check_points(side, f"anchors {name}")
        for side, name in zip(anchors, ("of the scan", "on the mesh"), strict=True)
    )
    if len(here) != len(there) or len(here) < 3:
        raise InvalidArrayError(
            f"at least 3 pairs of anchors are needed, got {len(here)} and {len(there)} points"
        )
    if in_a_row(here, IN_A_ROW):
        raise InvalidArrayError(f"the {len(here)} anchors of the scan lie in a row")
    return rigid_fit(here, there, np.ones(len(here)))


def _starts(start: FloatArray, scan: FloatArray, rng: np.random.Generator) -> list[FloatArray]:
    """Starts around the given one, and half turns about the scan's principal axes."""
    middle = transform_points(start, scan).mean(axis=0)
    _, _, axes = np.linalg.svd(transform_points(start, scan) - middle, full_matrices=False)
    steps = [np.append(np.pi * axis, np.zeros(3)) for axis in axes]
    for _ in range(TRIES):
        way = rng.normal(size=3)
        turn = rng.uniform(0.3, 1.0) * TURN * way / np.linalg.norm(way)
        steps.append(np.append(turn, rng.uniform(-SHIFT, SHIFT, 3)))
    return [_moved(start, middle, step) for step in steps]


def _astray(pose: FloatArray, here: ArrayLike, there: ArrayLike) -> tuple[str, ...]:
    """Anchors that are not where a pose carries them, in words."""
    points, places = np.asarray(here, np.float64), np.asarray(there, np.float64)
    missed = np.linalg.norm(transform_points(pose, points) - places, axis=1)
    rows = np.flatnonzero(missed > ASTRAY)
    if not len(rows):
        return ()
    words = ", ".join(f"{row + 1} ({1e3 * missed[row]:.0f} mm)" for row in rows.tolist())
    own, image = (
        np.linalg.norm(transform_points(rigid_fit(side, places, np.ones(len(side))), side) - places)
        for side in (points, points * [-1.0, 1.0, 1.0])
    )
    why = "exchanged anchors, or another pose that fits better than theirs"
    if len(points) > 3 and 2.0 * image < own:
        why = "they fit the mirror image, so mirror the scan"
    return (f"the scan's pose misses the anchors {words}: {why}",)


def _distinct(poses: list[FloatArray], scene: Scene) -> list[tuple[FloatArray, float]]:
    """Poses that are apart, polished with their standoffs [m], best first."""
    tried: list[FloatArray] = []
    for pose in poses:
        if all(scene.apart(pose, other) > APART for other in tried):
            tried.append(pose)
    kept: list[tuple[FloatArray, float]] = []
    # Single floats: of poses that differ by rounding alone, that from the given start comes first.
    ends = [polish(scene, pose) for pose in tried]
    for own in sorted(ends, key=lambda one: float(np.float32(scene.cost(*one)))):
        if all(scene.apart(own[0], other) > APART for other, _ in kept):
            kept.append(own)
    return kept


def _judged(
    scene: Scene,
    placed: tuple[FloatArray, float],
    second: tuple[FloatArray, float] | None,
    astray: tuple[str, ...],
) -> ScanRegistration:
    best, standoff = placed
    distance = scene.heights(best, standoff)
    on_mesh = np.abs(distance) < NEAR
    share = float(on_mesh.mean())
    rms = float(np.sqrt(np.mean(distance[on_mesh] ** 2))) if on_mesh.any() else float("nan")
    free, covariance = free_motions(scene, best, standoff)
    sd = float(np.sqrt(covariance[6, 6]))
    ratio = float("inf")
    if second is not None:
        ratio = scene.cost(*second) / max(scene.cost(*placed), 1e-18)
    found = [
        (Status.UNOBSERVABLE, f"the shape leaves a motion free: the scan {motion}")
        for motion in free
    ]
    found += [(Status.AMBIGUOUS, words) for words in astray]
    if ratio <= RIVAL and not free:
        words = f"another pose fits as well ({100 * (ratio - 1):.1f} % worse)"
        found.append((Status.AMBIGUOUS, f"{words}: give anchors or a better start"))
    if share < ON_MESH:
        words = f"only {100 * share:.0f} % of the scan lie within {1e3 * NEAR:g} mm of the mesh"
        found.append((Status.AMBIGUOUS, f"{words}: another link, or a start too far off"))
    if sd > TOLD:
        words = f"how thick a cover is cannot be told ({1e3 * sd:.1f} mm): scan more sides"
        found.append((Status.AMBIGUOUS, words))
    size, size_sd = (0.0, 0.0) if free or standoff else _size(scene, best)
    if abs(size) > max(SIZED, SURE * size_sd):
        words = f"the scan is {100 * abs(size):.1f} % too {'small' if size > 0 else 'large'}"
        found.append((Status.AMBIGUOUS, f"{words}: another unit, or a scanner to calibrate"))
    return ScanRegistration(
        best,
        found[0][0] if found else Status.OK,
        tuple(reason for _, reason in found),
        free,
        rms,
        standoff,
        sd,
        share,
        covariance[:6, :6],
        None if second is None else second[0],
        ratio,
    )


def _size(scene: Scene, pose: FloatArray) -> tuple[float, float]:
    """Share by which the scan of a bare link would have to grow to fit best, and its deviation."""
    grown, about = 0.0, scene.scan.mean(axis=0)
    for _ in range(ROUNDS):
        scaled = replace(scene, scan=about + np.exp(grown) * (scene.scan - about))
        rows, high, weight, middle = linearised(scaled, pose, 0.0)
        rows = np.delete(rows, 6, axis=1)  # a cover that is fitted as well would hide the size
        normal = (rows * weight[:, None]).T @ rows + 1e-9 * len(rows) * np.eye(7)
        inverse = np.asarray(np.linalg.inv(normal), np.float64)
        step = -inverse @ ((rows * weight[:, None]).T @ high)
        pose, grown = _moved(pose, middle, step[:6]), grown + float(step[6])
    square = max(float(weight @ high**2) / max(float(weight.sum()), 1.0), NOISE**2)
    return grown, float(np.sqrt(square * inverse[6, 6]))


def carried(
    found: ScanRegistration, scan: FloatArray, places: FloatArray, sigma: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Places (n, 3) of the scan in the frame of the mesh [m], and their covariances (n, 3, 3).

    `scan` (m, 3) [m] is what was registered: the pose's covariance turns about its middle. `sigma`
    (n,) [m] is the places' own error in each coordinate.
    """
    moved = transform_points(found.T_mesh_scan, places)
    arm = moved - transform_points(found.T_mesh_scan, scan).mean(axis=0)
    jacobian = motion_slopes(arm)
    covariance = np.einsum("nij,jk,nlk->nil", jacobian, found.covariance, jacobian)
    return moved, covariance + sigma[:, None, None] ** 2 * np.eye(3)


def free_motions(
    scene: Scene, pose: FloatArray, standoff: float
) -> tuple[tuple[str, ...], FloatArray]:
    """Free motions at a pose in words, and the covariance (7, 7) of the pose and the standoff.

    The motions tried are the eigenvectors of the normal matrix, turns measured at the scan's
    radius; each is carried out, as normals of a mesh waver more than its places. One that is
    stopped on one side only (a scan at the rim of a tube) is free.
    """
    rows, high, weight, middle = linearised(scene, pose, standoff)
    points = scene.scan @ pose[:3, :3].T + pose[:3, 3]
    radius = float(np.sqrt(np.mean(np.sum((points - middle) ** 2, axis=1))))
    scale = np.repeat([1.0 / radius, 1.0], [3, 4])
    scaled = rows[:, :7] * scale
    total = max(float(weight.sum()), 1.0)
    mean = (scaled * weight[:, None]).T @ scaled / total
    square = max(float(weight @ high**2) / total, NOISE**2)
    _, vectors = np.linalg.eigh(mean[:6, :6])
    mean[6, 6] += square / total / COVER_SIGMA**2
    covariance = square / total * np.linalg.inv(mean + 1e-9 * np.eye(7))
    covariance = covariance * np.outer(scale, scale)
    if standoff == 0.0:  # it was held, so the pose may be off by as much as it would have moved
        left = -covariance[:, :7] @ ((rows[:, :7] * weight[:, None]).T @ high) / square
        covariance += np.outer(covariance[:, 6], covariance[6]) * (left[6] / covariance[6, 6]) ** 2

    def level(step: FloatArray) -> float:
        """Mean square distance [m2] once the pose is moved by a turn [rad] and a shift [m]."""
        raised = scene.heights(_moved(pose, middle, step), standoff)
        return float(np.minimum(raised**2, WIDTH**2).mean())

    raised = [
        min(level(sign * MOVED * scale[:6] * vector) for sign in (-1, 1)) for vector in vectors.T
    ]
    free = vectors[:, np.array(raised) - level(np.zeros(6)) < RAISED * square]
    return _named(free, middle, radius, scene.target.vertices), covariance


def _named(
    free: FloatArray, middle: FloatArray, radius: float, link: FloatArray
) -> tuple[str, ...]:
    """Shifts and turns that span the free motions (6, k)."""
    if free.shape[1] == 0:
        return ()
    _, axes = np.linalg.eigh(np.cov(link.T))
    axes = axes.T[::-1]
    # Combinations of free motions by how much they turn: those that do not are shifts.
    _, turning, mix = np.linalg.svd(free[:3], full_matrices=True)
    amounts = np.zeros(free.shape[1])
    amounts[: len(turning)] = turning
    words = []
    for amount, motion in sorted(zip(amounts, (free @ mix.T).T, strict=True), key=lambda m: m[0]):
        if amount < PURE:
            words.append(f"slides along {_axis(motion[3:], axes)}")
        else:
            turn = motion[:3] / radius
            foot = middle + np.cross(turn, motion[3:]) / (turn @ turn)
            place = ", ".join(f"{1e3 * value:.0f}" for value in foot)
            words.append(f"turns about {_axis(turn, axes)} through ({place}) mm")
    return tuple(words)


def _axis(direction: FloatArray, axes: FloatArray) -> str:
    unit = direction / np.linalg.norm(direction)
    unit = unit * np.sign(unit[np.argmax(np.abs(unit))])
    cosine = np.abs(axes @ unit)
    numbers = ", ".join(f"{value + 0.0:.2f}" for value in np.round(unit, 2))
    if cosine.max() < 0.9:
        return f"({numbers})"
    return f"its {WORDS[int(np.argmax(cosine))]} ({numbers})"
