"""Flat maps: every patch of a surface mesh laid in the plane, with its distortion."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from skinmap.arrays import FloatArray, IntArray, freeze
from skinmap.errors import InvalidArrayError
from skinmap.flat.cutting import open_surface
from skinmap.flat.disc_map import DEFAULT, HOLE_SHARE, flatten_disc, map_disc
from skinmap.flat.distortion import Distortion, measure_distortion
from skinmap.flat.methods import flatteners
from skinmap.flat.packing import pack, upright
from skinmap.geometry.topology import check_surface
from skinmap.surface.surface_mesh import SurfaceMesh

CHART_GAP = 0.012  # between charts of one part [m]: seen as a gap, small beside a patch
__all__ = ["DEFAULT", "HOLE_SHARE", "Chart", "FlatMap", "flatten", "flatten_disc", "limb_axis"]


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
    reason : str
        Why this method, where `auto` chose it; otherwise empty.
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
    reason: str = ""

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


def flatten(
    mesh: SurfaceMesh,
    *,
    method: str = DEFAULT,
    max_seconds: float | None = None,
    max_edge_rms: float | None = None,
) -> FlatMap:
    """Lay every patch of a surface mesh flat and pack the charts.

    Parameters
    ----------
    mesh : SurfaceMesh
    method : str
        One of `flatteners.names()`.
    max_seconds : float, optional
        Only with `auto`: CPU time for all patches together [s].
    max_edge_rms : float, optional
        Only with `auto`: edge error that each patch should reach, 0.01 for 1 %.

    Raises
    ------
    UnknownNameError
        No such method.
    InvalidArrayError
        A budget that is not positive, or with another method than `auto`.
    FlatteningError
        A patch with a triangle without area, or one that no method lays flat without a flip.
    """
    flatteners.get(method)
    check_budget(method, max_seconds, max_edge_rms)
    charts, weights = [], [len(mesh.patch_faces(patch)) for patch in range(mesh.n_patches)]
    for patch, weight in enumerate(weights):
        # What earlier patches left of the time, shared out by size.
        share = max_seconds and max_seconds * weight / sum(weights[patch:])
        charts.append(_flatten_patch(mesh, patch, method, share, max_edge_rms))
        max_seconds = max_seconds and max(max_seconds - charts[-1].seconds, 1e-9)
    placed = pack([chart.uv for chart in charts], CHART_GAP)
    charts = [replace(chart, uv=flat) for chart, flat in zip(charts, placed, strict=True)]
    uv = np.full((len(mesh.skin), 2), np.nan)
    for chart in charts:
        uv[chart.taxels] = chart.uv
    return FlatMap(mesh, tuple(charts), uv[mesh.representative])


def check_budget(method: str, max_seconds: float | None, max_edge_rms: float | None) -> None:
    """Refuse budgets that are not positive, or that no choice follows.

    Raises
    ------
    InvalidArrayError
    """
    for name, value in (("max_seconds", max_seconds), ("max_edge_rms", max_edge_rms)):
        if value is None:
            continue
        if not value > 0.0:
            raise InvalidArrayError(f"{name} must be above 0, got {value}")
        if method != "auto":
            raise InvalidArrayError(f"{name} needs method 'auto', got {method!r}")


def _flatten_patch(
    mesh: SurfaceMesh,
    patch: int,
    method: str,
    max_seconds: float | None,
    max_edge_rms: float | None,
) -> Chart:
    taxels, compact = np.unique(mesh.patch_faces(patch), return_inverse=True)
    faces = compact.reshape(-1, 3)
    vertices = mesh.vertices[taxels]
    where = f"patch {patch} of {mesh.skin.part!r}"
    started = time.process_time()
    check_surface(faces)
    cut = open_surface(vertices, faces, hole_share=HOLE_SHARE)
    vertices, faces, taxels = vertices[cut.origin], cut.faces, taxels[cut.origin]
    flat = map_disc(
        vertices,
        faces,
        method=method,
        where=where,
        max_seconds=max_seconds,
        max_edge_rms=max_edge_rms,
    )
    seconds = time.process_time() - started
    uv = upright(flat.uv, vertices @ limb_axis(mesh.vertices))
    distortion = measure_distortion(vertices, faces, uv)
    return Chart(
        patch,
        taxels,
        faces,
        uv,
        distortion,
        flat.method,
        flat.fallback,
        flat.holes,
        cut.seam_length,
        seconds,
        flat.reason,
    )


def limb_axis(points: FloatArray) -> FloatArray:
    """Unit direction (3,) of the largest spread, towards +z of the link."""
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    strongest = np.argmax(np.abs(axes[0]))
    axis = axes[0] * np.sign(axes[0][2] if abs(axes[0][2]) > 0.5 else axes[0][strongest])
    return np.asarray(axis)
