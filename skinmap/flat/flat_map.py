"""Flat maps: every patch of a surface mesh laid in the plane, with its distortion."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import FloatArray, IntArray, freeze
from skinmap.errors import FlatteningError, SkinWarning
from skinmap.flat.atlas import Laid, arrange
from skinmap.flat.cutting import open_surface
from skinmap.flat.distortion import Distortion, measure_distortion
from skinmap.flat.methods import flatteners
from skinmap.flat.orientation import limb_frame, turn_upright
from skinmap.geometry.topology import (
    boundary_loops,
    check_surface,
    euler_number,
    loop_length,
)
from skinmap.geometry.triangles import signed_areas, smallest_altitudes
from skinmap.surface.holes import close_loop
from skinmap.surface.surface_mesh import SurfaceMesh

DEFAULT = "balanced"
HOLE_SHARE = 0.35  # a hole's length against the border's: up to here it is filled for the solve
FALLBACK = "tutte"  # a fixed convex border never flips a triangle (Floater 2003)


@dataclass(frozen=True, eq=False, slots=True)
class Chart:
    """The flat map of one patch.

    Attributes
    ----------
    patch : int
        Number of the patch in its surface mesh.
    taxels : (k,) int
        Taxel of each chart vertex; taxels on a seam come twice or more.
    faces : (m, 3) int
        Chart vertices.
    uv : (k, 2) float
        Packed beside the other charts [m].
    distortion : Distortion
    method : str
        The method that made it.
    fallback : bool
        Whether that is not the one asked for.
    holes : int
        Boundary loops beside the outer one.
    seam_length : float
        Of the cuts that opened a tube or a closed skin [m].
    seconds : float
        CPU time of the solve.
    """

    patch: int
    taxels: IntArray
    faces: IntArray
    uv: FloatArray
    distortion: Distortion
    method: str
    fallback: bool
    holes: int
    seam_length: float
    seconds: float

    def __post_init__(self) -> None:
        freeze(self, taxels=self.taxels, faces=self.faces, uv=self.uv)


@dataclass(frozen=True, eq=False, slots=True)
class FlatMap:
    """Charts of all patches of one part, packed at one scale.

    Attributes
    ----------
    mesh : SurfaceMesh
    charts : tuple of Chart
    uv : (n, 2) float
        Packed coordinates of every taxel [m], one of them for a taxel on a seam; NaN for a
        taxel that no face uses.
    """

    mesh: SurfaceMesh
    charts: tuple[Chart, ...]
    uv: FloatArray

    def __post_init__(self) -> None:
        freeze(self, uv=self.uv)

    @property
    def flips(self) -> int:
        """Triangles turned over, all charts together."""
        return sum(chart.distortion.flips for chart in self.charts)


def flatten(mesh: SurfaceMesh, *, method: str = DEFAULT, avoid: ArrayLike | None = None) -> FlatMap:
    """Lay every patch of a surface mesh flat and pack the charts.

    Parameters
    ----------
    mesh : SurfaceMesh
    method : str
        One of `flatteners.names()`.
    avoid : (k,) array-like of int, optional
        Taxels that seams keep away from where there is another way.

    Raises
    ------
    UnknownNameError
        No such method.
    FlatteningError
        A patch with a triangle without area, or one that no method lays flat without a flip.
    """
    flatteners.get(method)
    away = mesh.representative[np.asarray([] if avoid is None else avoid, np.int64)]
    charts = [_flatten_patch(mesh, patch, method, away) for patch in range(mesh.n_patches)]
    charts = _arranged(mesh, charts)
    uv = np.full((len(mesh.skin), 2), np.nan)
    for chart in charts:
        uv[chart.taxels] = chart.uv
    return FlatMap(mesh, tuple(charts), uv[mesh.representative])


def _flatten_patch(mesh: SurfaceMesh, patch: int, method: str, avoid: IntArray) -> Chart:
    taxels, compact = np.unique(mesh.patch_faces(patch), return_inverse=True)
    faces = compact.reshape(-1, 3)
    vertices = mesh.vertices[taxels]
    where = f"patch {patch} of {mesh.skin.part!r}"
    started = time.process_time()
    check_surface(faces)
    away = np.flatnonzero(np.isin(taxels, avoid))
    cut = open_surface(vertices, faces, hole_share=HOLE_SHARE, avoid=away)
    vertices, faces, taxels = vertices[cut.origin], cut.faces, taxels[cut.origin]
    uv, used, holes = flatten_disc(vertices, faces, method=method, where=where)
    seconds = time.process_time() - started
    distortion = measure_distortion(vertices, faces, uv)
    return Chart(
        patch,
        taxels,
        faces,
        uv,
        distortion,
        used,
        used != method,
        holes,
        cut.seam_length,
        seconds,
    )


def _arranged(mesh: SurfaceMesh, charts: list[Chart]) -> list[Chart]:
    """Charts turned so that the limb's axis is up, and laid out as they lie on the body."""
    if not charts:
        return []
    frame = limb_frame(mesh.vertices, mesh.faces, mesh.skin.up)
    shapes = []
    for chart in charts:
        vertices = mesh.vertices[chart.taxels]
        shapes.append(Laid(vertices, chart.faces, turn_upright(chart.uv, vertices, frame)))
    # Left and right parts mirror each other: what could lie on either side lies inwards or
    # outwards on both.
    placed = arrange(shapes, side=-1.0 if mesh.skin.part.startswith("left") else 1.0)
    return [replace(chart, uv=uv) for chart, uv in zip(charts, placed, strict=True)]


def flatten_disc(
    vertices: FloatArray, faces: IntArray, *, method: str = DEFAULT, where: str = "mesh"
) -> tuple[FloatArray, str, int]:
    """Flatten one connected surface with a border; small holes are filled for the solve.

    Parameters
    ----------
    vertices : (n, 3) array of float
        [m]; every vertex belongs to a face.
    faces : (m, 3) array of int
    method : str
        One of `flatteners.names()`.
    where : str
        How messages call it.

    Returns
    -------
    uv : (n, 2) array of float
        Finite, flip-free by our own check [m].
    method : str
        The method that made it, which is not the one asked for where that one failed.
    holes : int
        Boundary loops beside the outer one.

    Raises
    ------
    FlatteningError
        No border, a hole too wide to fill (a tube), or a triangle without area.
    """
    check_surface(faces)
    if smallest_altitudes(vertices, faces).min() <= 1e-12 * np.ptp(vertices, axis=0).max():
        raise FlatteningError(f"{where} has a triangle without area")
    loops = sorted(boundary_loops(faces), key=lambda loop: -loop_length(vertices, loop))
    if not loops:
        raise FlatteningError(f"{where} is closed: cut it open first")
    filled = [faces]
    for loop in loops[1:]:
        if loop_length(vertices, loop) > HOLE_SHARE * loop_length(vertices, loops[0]):
            raise FlatteningError(f"{where} is a tube or has a wide hole: cut it open first")
        filled.append(close_loop(vertices, _vertex_normals(vertices, faces), loop))
    disc = np.concatenate(filled)
    if euler_number(disc) != 1:
        raise FlatteningError(f"{where} is no disc: Euler number {euler_number(disc)}")
    centre, size = vertices.mean(axis=0), np.ptp(vertices, axis=0).max()
    unit_size = (vertices - centre) / size
    for name in (method, "bff", FALLBACK):
        uv = flatteners.get(name)(unit_size, disc, loops[0])
        if np.isfinite(uv).all() and (signed_areas(uv, faces) > 0).all():
            break
    else:
        raise FlatteningError(f"{where}: neither {method} nor a convex map is free of flips")
    if name != method:
        warnings.warn(f"{where}: {method} flips, {name} is used", SkinWarning, stacklevel=3)
    return uv * size, name, len(loops) - 1


def _vertex_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    from skinmap.geometry.triangles import cross_products, unit

    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], cross_products(vertices, faces))
    return unit(normals)
