"""Surface mesh: triangles whose vertices are taxels."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import FloatArray, IntArray, check_faces, freeze
from skinmap.errors import InvalidMeshError, SkinWarning, check_known
from skinmap.geometry.topology import check_surface, face_components
from skinmap.geometry.triangles import TriangleMesh, vertex_areas
from skinmap.skin.normals import on_a_line
from skinmap.skin.skin import Skin, skin_from_points
from skinmap.summary import Drawable, first_few
from skinmap.surface.accurate import accurate_faces
from skinmap.surface.consensus_meshing import (
    SMALL_HOLE,
    Limits,
    one_fan,
    voted_faces,
)
from skinmap.surface.taxel_cloud import FEW, NEIGHBOURS, Cloud, delaunay_stars

MESHING = ("consensus", "fast", "accurate")
DEFAULT = MESHING[0]


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class SurfaceMesh(Drawable):
    """Triangles over the taxels of a skin; none over one or two, each of which is a disc.

    Attributes
    ----------
    skin : Skin
        The n taxels.
    faces : (m, 3) int
        Taxel indices, counter-clockwise seen from outside.
    representative : (n,) int
        The taxel that stands for each taxel in the mesh: itself but for near-coincident ones.
    face_patches : (m,) int
        Patch of each face, 0 first; the largest patch has number 0.

    Examples
    --------
    >>> import skinmap
    >>> skinmap.build_surface(skinmap.load_robot("kaspar").skin("torso"))
    SurfaceMesh(part=torso, taxels=240, faces=426, patches=1, area=67.1 cm2)
    """

    FIGURE: ClassVar = "skinmap.report.flat_figures:mesh_figure"
    skin: Skin
    faces: IntArray
    representative: IntArray
    face_patches: IntArray

    def __post_init__(self) -> None:
        faces = check_faces(self.faces, len(self.skin))
        check_surface(faces)
        freeze(
            self,
            faces=faces,
            representative=np.asarray(self.representative, np.int64),
            face_patches=np.asarray(self.face_patches, np.int64),
        )

    @property
    def vertices(self) -> FloatArray:
        """(n, 3) taxel positions [m]."""
        return self.skin.positions

    @property
    def n_patches(self) -> int:
        """Number of connected patches."""
        return int(self.face_patches.max(initial=-1 if len(self.faces) else 0)) + 1

    @property
    def taxel_patches(self) -> IntArray:
        """(n,) patch of each taxel; -1 for a taxel that no face uses."""
        patch = np.full(len(self.skin), -1 if len(self.faces) else 0, np.int64)
        patch[self.faces.ravel()] = np.repeat(self.face_patches, 3)
        return patch[self.representative]

    def left_out(self) -> str:
        """The taxels that no face uses, in words; empty where there is none."""
        out = self.skin.channels[self.taxel_patches < 0].tolist()
        return f"{len(out)} taxels are in no triangle: channels {first_few(out, 20)}" * bool(out)

    @property
    def taxel_areas(self) -> FloatArray:
        """(n,) skin area that each taxel stands for [m2]: a third of its triangles.

        Taxels merged into one vertex share its area; that of a disc is as wide as the spacing.
        """
        if len(self.faces) == 0:
            return np.full(len(self.skin), 0.25 * np.pi * self.skin.spacing**2)
        areas = vertex_areas(self.vertices, self.faces)
        share = np.bincount(self.representative, minlength=len(areas))
        return areas[self.representative] / share[self.representative]

    def patch_faces(self, patch: int) -> IntArray:
        """(k, 3) faces of one patch."""
        return self.faces[self.face_patches == patch]

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "part": self.skin.part,
            "taxels": len(self.skin),
            "faces": len(self.faces),
            "patches": self.n_patches,
            "area": f"{1e4 * self.taxel_areas.sum():.3g} cm2",
        }


def build_surface(
    skin: Skin,
    *,
    method: str = DEFAULT,
    max_edge: float | None = None,
    merge: float | None = None,
    least_altitude: float | None = None,
    largest_hole: int = SMALL_HOLE,
    faces: ArrayLike | None = None,
    body: TriangleMesh | tuple[ArrayLike, ArrayLike] | None = None,
) -> SurfaceMesh:
    """Delaunay surface mesh over all taxels of a skin.

    Each taxel votes for the triangles of its own tangent-plane Delaunay star; triangles are
    taken greedily by votes while the mesh stays a manifold; small holes are closed. One or two
    taxels have no triangle: each stands for a disc.

    Parameters
    ----------
    skin : Skin
        Positions and outward normals.
    method : str
        One of `MESHING`: "consensus" as above; "fast" with stars of fewer neighbours; "accurate"
        along the surface of a body, so that taxels on two sides of it are never joined.
    max_edge : float, optional
        Longest edge allowed [m]; by default 2.5 times the spacing: the median one, and about a
        coarser area its own.
    merge : float, optional
        Taxels up to this distance from each other [m] share a vertex; 1 % of the spacing.
    least_altitude : float, optional
        Flatter triangles [m] are three taxels in a row and left out; 2 % of the spacing.
    largest_hole : int
        Inner loops of up to so many vertices are closed; longer ones are real holes.
    faces : (m, 3) array-like of int, optional
        Triangles of the user's own over the taxels, counter-clockwise seen from outside: they
        are checked and taken as they are, but for patches that are inside out.
    body : TriangleMesh or (vertices, faces), optional
        The link's mesh [m] in the frame of the taxels, for "accurate".

    Returns
    -------
    SurfaceMesh
        Triangles (m, 3) over the taxels, numbered by patch.

    Raises
    ------
    UnknownNameError
        No such method.
    InvalidMeshError
        Three or more taxels at fewer than three places, none that are near enough to be joined,
        faces that are no oriented manifold, or no body for "accurate".

    Examples
    --------
    >>> import skinmap
    >>> mesh = skinmap.build_surface(skinmap.load_robot("kaspar").skin("torso"))
    >>> mesh.faces.shape[1], mesh.n_patches
    (3, 1)
    """
    if faces is not None:
        return surface_from_faces(skin, faces)
    check_known("meshing method", [method], MESHING)
    in_a_row = on_a_line(skin.positions) and len(np.unique(skin.positions, axis=0)) > 2
    if 0 < len(skin) < 3 or in_a_row:
        none = np.zeros(0, np.int64)
        return SurfaceMesh(skin, none.reshape(0, 3), np.arange(len(skin)), none)
    if skin.pieces is not None:
        how: dict[str, Any] = {"method": method, "largest_hole": largest_hole, "body": body}
        how |= {"max_edge": max_edge, "merge": merge, "least_altitude": least_altitude}
        return _by_pieces(skin, how)
    cloud = Cloud(skin.positions, skin.normals, merge)
    limits = Limits(cloud, max_edge, least_altitude, largest_hole)
    if method == "accurate":
        found = accurate_faces(cloud, limits, _as_body(body, skin))
    else:
        neighbours = FEW if method == "fast" else NEIGHBOURS
        votes = delaunay_stars(cloud, limits.max_edge, neighbours=neighbours)
        found = voted_faces(cloud, limits, votes)
    if len(found) == 0:
        raise InvalidMeshError(
            f"no three of {len(cloud.vertices)} taxels lie within "
            f"{limits.max_edge.max() * cloud.unit:.3g} m of each other without being in a row: "
            "no surface there"
        )
    return SurfaceMesh(skin, cloud.vertices[found], cloud.representative, by_size(found))


def _by_pieces(skin: Skin, how: Mapping[str, Any]) -> SurfaceMesh:
    """The meshes of a skin's shells as one: no triangle goes from one to another."""
    assert skin.pieces is not None
    faces, representative = [], np.arange(len(skin))
    for piece in np.unique(skin.pieces):
        rows = np.flatnonzero(skin.pieces == piece)
        alone = skin_from_points(skin.positions[rows], skin.normals[rows], part=skin.part)
        own = build_surface(alone, **how)
        faces.append(rows[own.faces])
        representative[rows] = rows[own.representative]
    every = np.concatenate(faces)
    return SurfaceMesh(skin, every, representative, by_size(every))


def surface_from_faces(skin: Skin, faces: ArrayLike) -> SurfaceMesh:
    """The surface mesh that a user's own triangles (m, 3) make, with its patches numbered.

    Patches that are inside out, by the normals of the taxels, are turned, with a warning.

    Raises
    ------
    InvalidMeshError
        No triangle, an index outside, a triangle that names a taxel twice, an edge in more than
        two, neighbours that turn opposite ways, or patches that meet in one vertex.
    """
    own = check_faces(faces, len(skin))
    if len(own) == 0:
        raise InvalidMeshError("no faces: a surface mesh needs at least one triangle")
    twice = (own == own[:, [1, 2, 0]]).any(axis=1)
    if twice.any():
        row = int(np.argmax(twice))
        raise InvalidMeshError(f"face {row} names a taxel twice: {own[row].tolist()}")
    check_surface(own)
    pinched = own.ravel()[~one_fan(own)]
    if len(pinched):
        raise InvalidMeshError(
            f"the faces meet in one vertex only at taxel {pinched[0]}: not manifold"
        )
    patches = by_size(own)
    a, b, c = np.moveaxis(skin.positions[own], 1, 0)
    outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), skin.normals[own].sum(axis=1))
    inside_out = np.bincount(patches, outward) < 0
    if inside_out.any():
        names = first_few(np.flatnonzero(inside_out).tolist())
        message = f"faces of {skin.part!r} were inside out in patch {names}: they are turned"
        warnings.warn(message, SkinWarning, stacklevel=3)
        own = np.where(inside_out[patches, None], own[:, ::-1], own)
    return SurfaceMesh(skin, own, np.arange(len(skin)), patches)


def by_size(faces: IntArray) -> IntArray:
    """(m,) patch of each face, the patch with the most faces first."""
    label = face_components(faces)
    rank = np.argsort(np.argsort(-np.bincount(label), kind="stable"))
    return rank[label]


def _as_body(body: TriangleMesh | tuple[ArrayLike, ArrayLike] | None, skin: Skin) -> TriangleMesh:
    if body is None:
        raise InvalidMeshError(
            f"method 'accurate' follows the surface of a body, and {skin.part!r} came without "
            "one: give body=(vertices, faces), or use 'consensus'"
        )
    mesh = body if isinstance(body, TriangleMesh) else TriangleMesh(*body)  # type: ignore[arg-type]
    if len(mesh.faces) == 0:
        raise InvalidMeshError("the body has no faces: method 'accurate' follows its surface")
    return mesh
