"""Iterative closest points for a scan: staged through Open3D, then polished on the mesh itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.patch.link_surface import OFFSET, Target
from skinmap.arrays import FloatArray
from skinmap.geometry.rigid import transform_points
from skinmap.geometry.triangles import face_areas, unit
from skinmap.imports import import_optional

STAGES = (20e-3, 10e-3, 4e-3)  # longest correspondences [m]: first squares, then Tukey's loss
STEPS = 40  # a stage at most
SAMPLES = 15_000  # points of the mesh that Open3D sees
WIDTH = 3e-3  # beyond which Tukey's loss no longer sees a point [m]
FEW = 600  # points of a scan that look for other poses
POLISH = 12  # steps on the mesh itself
ROUNDING = 1e-7  # of the pose handed over: what Open3D's threads add up in another order


@dataclass(eq=False)
class Scene:
    """A scan (m, 3) [m], the target it goes on, and both as Open3D holds them."""

    target: Target
    scan: FloatArray
    _source: Any
    _few: Any
    _surface: Any

    def heights(self, pose: FloatArray) -> FloatArray:
        """(m,) signed distance of the scan from the mesh [m]; the wrap stands off by OFFSET."""
        points = transform_points(pose, self.scan)
        close, normals = self.target.project(points)
        step = points - close
        high = np.einsum("md,md->m", step, normals) + OFFSET
        # Off an edge or far away the distance is what counts, not the part along the normal.
        return np.where(np.abs(high) < WIDTH, high, np.linalg.norm(step, axis=1))

    def cost(self, pose: FloatArray) -> float:
        """Mean of Tukey's loss [m2]."""
        return float(_tukey(self.heights(pose)).mean())

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
    kernels = [None] * len(STAGES) + [o3d.TukeyLoss(k=WIDTH)]
    for reach, kernel in zip((*STAGES, STAGES[-1]), kernels, strict=True):
        plane = (
            o3d.TransformationEstimationPointToPlane()
            if kernel is None
            else o3d.TransformationEstimationPointToPlane(kernel)
        )
        pose = o3d.registration_icp(
            scene._few if roughly else scene._source, scene._surface, reach, pose, plane, criteria
        ).transformation
    return np.asarray(pose)


def polish(scene: Scene, pose: FloatArray) -> FloatArray:
    """Gauss and Newton's steps with Tukey's weights on the mesh itself, not on samples of it."""
    pose = _rounded(pose)
    for _ in range(POLISH):
        rows, high, weight, middle = linearised(scene, pose)
        normal = (rows * weight[:, None]).T @ rows + 1e-9 * len(rows) * np.eye(6)
        step = np.linalg.solve(normal, -(rows * weight[:, None]).T @ high)
        move = np.eye(4)
        move[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix()
        move[:3, 3] = middle + step[3:] - move[:3, :3] @ middle
        pose = move @ pose
        if np.abs(step).max() < 1e-9:
            break
    return pose


def linearised(
    scene: Scene, pose: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Derivatives (m, 6), heights (m,) [m], weights (m,) and the point (3,) turned about [m].

    Unknowns: a rotation vector [rad] about the scan's middle, then a shift [m].
    """
    points = transform_points(pose, scene.scan)
    close, normals = scene.target.project(points)
    high = np.einsum("md,md->m", points - close, normals) + OFFSET
    far = np.linalg.norm(points - close, axis=1) > WIDTH
    weight = np.where(far, 0.0, np.maximum(1.0 - (high / WIDTH) ** 2, 0.0) ** 2)
    middle = points.mean(axis=0)
    return np.hstack([np.cross(points - middle, normals), normals]), high, weight, middle


def _tukey(distance: FloatArray) -> FloatArray:
    inside = np.clip(1.0 - (distance / WIDTH) ** 2, 0.0, 1.0)
    return np.asarray(WIDTH**2 / 6.0 * (1.0 - inside**3))


def _rounded(pose: FloatArray) -> FloatArray:
    turn = Rotation.from_matrix(pose[:3, :3]).as_rotvec()
    clean = np.eye(4)
    clean[:3, :3] = Rotation.from_rotvec(np.round(turn / ROUNDING) * ROUNDING).as_matrix()
    clean[:3, 3] = np.round(pose[:3, 3] / ROUNDING) * ROUNDING
    return clean
