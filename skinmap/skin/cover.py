"""How well a skin fits its link, and why it stands off: a cover that no mesh has, or a wrong frame.

A cover keeps the skin at a steady distance, with normals that agree with the link's, whichever
way the link faces. A wrong frame brings some taxels nearer and takes others away, or into the
body. Only where the skin is flat are the two alike: then a rigid move lays it on the link, and
both are said.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from skinmap.arrays import BoolArray, FloatArray, Frozen, IntArray
from skinmap.geometry.proximity import closest_on_mesh, nearest
from skinmap.geometry.rigid import turn_about
from skinmap.geometry.triangles import TriangleMesh, face_normals
from skinmap.skin.normals import hidden_views
from skinmap.skin.skin import Skin


@dataclass(frozen=True, eq=False, slots=True)
class SkinFit(Frozen):
    """Measures per taxel (n,).

    Attributes
    ----------
    distance : (n,) float
        To the link's mesh [m].
    pitch : (n,) float
        To the nearest other taxel [m].
    normal_angle : (n,) float
        Between the normal and that of the nearest face, sign aside [rad].
    inward : (n,) bool
        The body hides the view along the normal and leaves that against it free: the normal
        points the wrong way.
    covered : (n,) bool
        The body hides both views: the taxel lies under a cover of the link's mesh.
    """

    distance: FloatArray
    pitch: FloatArray
    normal_angle: FloatArray
    inward: BoolArray
    covered: BoolArray


def measure_fit(skin: Skin, body: TriangleMesh) -> SkinFit:
    """Compare a skin with the mesh of its link, both in the link's frame.

    Parameters
    ----------
    skin : Skin
    Of n taxels.
    body : TriangleMesh
    Of its link.

    Returns
    -------
    SkinFit
    Distance, angle and side of each taxel.

    Examples
    --------
    >>> import skinmap
    >>> from skinmap.skin import measure_fit
    >>> robot = skinmap.load_robot("icub")
    >>> fit = measure_fit(robot.skin("left_hand"), robot.mesh_under("left_hand"))
    >>> fit.distance.shape
    (48,)
    """
    distance, face, _ = closest_on_mesh(skin.positions, body.vertices, body.faces)
    cosine = np.einsum("ij,ij->i", face_normals(body.vertices, body.faces)[face], skin.normals)
    gap = np.zeros((1, 1))
    if len(skin) > 1:
        gap, _ = nearest(skin.positions, 1)
    above, below = hidden_views(skin.positions, skin.normals, body)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    return SkinFit(distance, gap[:, 0], angle, above & ~below, above & below)


FAR = 5e-3  # a taxel further than this from where it should be is not there [m]
STEADY = 0.5  # the middle nine tenths of the distances spread by less, in medians
ALONG = np.radians(35.0)  # normals of skin on a cover keep within this of the link's
ALIGNED = 0.9  # share of the normals that do
HIDDEN = 0.02  # share of taxels that may look into the body or lie inside it
LAID = 0.25  # a rigid move that leaves less than this of the distance explains it

Why = Literal["on it", "a cover", "a frame", "a cover or a frame"]


@dataclass(frozen=True, slots=True)
class Standing:
    """Fit of a skin to its link.

    Attributes
    ----------
    why : str
        "on it" where it stands as the manifest says.
    far : int
        Taxels more than 5 mm from where they should be.
    low, median, high : float
        Distances from the link: 5th, 50th and 95th percentile [m].
    shift : float
        How far a rigid move would take it that lays it on the link [m]; NaN where none does.
    """

    why: Why
    far: int
    low: float
    median: float
    high: float
    shift: float = float("nan")


def judge_standing(skin: Skin, body: TriangleMesh, found: SkinFit, cover: float = 0.0) -> Standing:
    """Whether a skin stands as it should, else whether a cover or a wrong frame explains it.

    Parameters
    ----------
    skin : Skin
    body : TriangleMesh
        Of its link, or of its cover.
    found : SkinFit
        Of the two.
    cover : float
        Thickness of the cover that is known of [m].
    """
    far = int((np.abs(found.distance - cover) > FAR).sum())
    low, median, high = np.percentile(found.distance, [5.0, 50.0, 95.0]).tolist()
    if far == 0:
        return Standing("on it", far, low, median, high)
    hidden = float((found.inward | found.covered).mean())
    along = float((found.normal_angle < ALONG).mean())
    steady = high - low < STEADY * median and median > FAR
    if not steady or hidden > HIDDEN or along < ALIGNED:
        return Standing("a frame", far, low, median, high)
    moved = fit_to_mesh(skin.positions, body.vertices, body.faces)
    if moved.after.mean() < LAID * moved.before.mean():
        return Standing("a cover or a frame", far, low, median, high, moved.shift)
    return Standing("a cover", far, low, median, high)


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
    shift : float
        How far it moves the middle of the points [m].
    """

    T_fit_now: FloatArray
    before: FloatArray
    after: FloatArray
    shift: float


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
    transform = turn_about(centre, rotation, shift)
    return RigidFit(transform, before, after, float(np.linalg.norm(shift)))
