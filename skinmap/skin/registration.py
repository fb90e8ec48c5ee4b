"""Rigid fit of a part's taxels to the mesh of its link."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from skinmap.arrays import FloatArray, IntArray, freeze
from skinmap.geometry.proximity import closest_on_mesh
from skinmap.geometry.rigid import transform_points

STEPS = 60  # of reweighting: the mean distance settles to 0.1 % within 40 on the iCub
NEAREST = 1e-4  # distances below 0.1 mm weigh alike [m]: it is the roughness of the meshes
STIFFNESS = 1e-3  # against sliding where the mesh does not hold the taxels, per unit weight


@dataclass(frozen=True, eq=False, slots=True)
class RigidFit:
    """A fit of points to a mesh.

    Attributes
    ----------
    T_fit_now : (4, 4) float
        Carries the points as they are to where they fit.
    before, after : (n,) float
        Distances to the mesh [m].
    middle : (3,) float
        Of the points as they are [m].
    """

    T_fit_now: FloatArray
    before: FloatArray
    after: FloatArray
    middle: FloatArray

    def __post_init__(self) -> None:
        freeze(self, T_fit_now=self.T_fit_now, before=self.before, after=self.after)
        freeze(self, middle=self.middle)

    @property
    def shift(self) -> float:
        """How far the fit moves the middle of the points [m]."""
        moved = transform_points(self.T_fit_now, self.middle[None])[0]
        return float(np.linalg.norm(moved - self.middle))

    @property
    def angle(self) -> float:
        """How far it turns [rad]."""
        return float(Rotation.from_matrix(self.T_fit_now[:3, :3]).magnitude())


def fit_to_mesh(points: FloatArray, vertices: FloatArray, faces: IntArray) -> RigidFit:
    """Rigid motion that brings points (n, 3) [m] nearest to a mesh in the mean distance.

    Point to closest point along the line between them, reweighted for the mean and not the mean
    square, so that taxels off the cover do not pull the rest away; the best pose on the way is
    kept. A weak spring holds what the mesh leaves free (sliding along a limb).
    """
    centre = points.mean(axis=0)
    size = np.ptp(points, axis=0).max()
    rotation, shift = np.eye(3), np.zeros(3)
    moved = points
    before, _, closest = closest_on_mesh(moved, vertices, faces)
    distance, best = before, (before, rotation, shift)
    for _ in range(STEPS):
        weight = 1.0 / np.maximum(distance, NEAREST)
        away = (moved - closest) / np.maximum(distance, np.finfo(float).tiny)[:, None]
        arm = np.cross(moved - centre - shift, away) / size
        jacobian = np.column_stack([arm, away])
        normal = jacobian.T @ (jacobian * weight[:, None]) + STIFFNESS * weight.sum() * np.eye(6)
        step = np.linalg.solve(normal, -jacobian.T @ (weight * distance))
        rotation = Rotation.from_rotvec(step[:3] / size).as_matrix() @ rotation
        shift = shift + step[3:]
        moved = (points - centre) @ rotation.T + centre + shift
        distance, _, closest = closest_on_mesh(moved, vertices, faces)
        if distance.mean() < best[0].mean():
            best = (distance, rotation, shift)
    after, rotation, shift = best
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = centre + shift - rotation @ centre
    return RigidFit(transform, before, after, centre)
