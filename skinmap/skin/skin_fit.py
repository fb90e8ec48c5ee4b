"""How well a skin fits its body: distances, pitch and normals against the link's mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, freeze
from skinmap.geometry.mesh import TriangleMesh
from skinmap.geometry.proximity import closest_on_mesh, nearest, ray_hits
from skinmap.geometry.triangles import face_normals
from skinmap.skin.normals import LIFT
from skinmap.skin.skin import Skin


@dataclass(frozen=True, eq=False, slots=True)
class SkinFit:
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

    def __post_init__(self) -> None:
        freeze(self, **{name: getattr(self, name) for name in self.__slots__})


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
    gap, _ = nearest(skin.positions, 1)
    lift = skin.normals * (LIFT * float(np.median(gap)))
    above = ray_hits(skin.positions + lift, skin.normals, body.vertices, body.faces)
    below = ray_hits(skin.positions - lift, -skin.normals, body.vertices, body.faces)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    return SkinFit(distance, gap[:, 0], angle, above & ~below, above & below)
