"""Flat maps: every patch of a surface mesh laid in the plane, with its distortion."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import FloatArray, IntArray, check_finite, freeze
from skinmap.errors import InvalidArrayError
from skinmap.flat.atlas import Laid, arrange
from skinmap.flat.disc_map import DEFAULT, HOLE_SHARE, flatten_disc, map_disc
from skinmap.flat.distortion import Distortion, measure_distortion
from skinmap.flat.methods import check_effort, flatteners
from skinmap.flat.orientation import limb_frame, turn_upright
from skinmap.flat.seams import open_surface
from skinmap.geometry.topology import check_surface, edges
from skinmap.skin.svg_picture import svg_picture
from skinmap.summary import Summary, listed
from skinmap.surface.surface_mesh import SurfaceMesh

__all__ = ["DEFAULT", "HOLE_SHARE", "Chart", "FlatMap", "flatten", "flatten_disc"]


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


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class FlatMap(Summary):
    """Charts of all patches of one part, packed at one scale.

    Attributes
    ----------
    mesh : SurfaceMesh
    charts : tuple of Chart
    uv : (n, 2) float
        Packed coordinates of every taxel [m], one of them for a taxel on a seam; NaN for a
        taxel that no face uses.

    Examples
    --------
    >>> import skinmap
    >>> skin = skinmap.load_robot("kaspar").skin("torso")
    >>> flat = skinmap.flatten(skinmap.build_surface(skin))
    >>> flat.uv.shape, flat.flips
    ((240, 2), 0)
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

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        shown = self.uv[np.isfinite(self.uv[:, 0])]
        width, height = 1e2 * np.ptp(shown, axis=0) if len(shown) else (0.0, 0.0)
        return {
            "part": self.mesh.skin.part,
            "taxels": len(self.uv),
            "charts": len(self.charts),
            "size": f"{width:.3g} x {height:.3g} cm",
            "methods": listed(dict.fromkeys(chart.method for chart in self.charts)),
            "flips": self.flips,
        }

    def _repr_html_(self) -> str:
        """A picture for notebooks: edges and taxels of all charts."""
        lines = [chart.uv[edges(chart.faces)] for chart in self.charts]
        rms = max((chart.distortion.edge_rms for chart in self.charts), default=0.0)
        count = len(self.charts)
        words = (
            f"{self.mesh.skin.part}: {len(self.uv):,} taxels, {count} "
            f"{'patch' if count == 1 else 'patches'}, {self.flips} flipped triangles, "
            f"edge rms at most {100 * rms:.2f} %"
        )
        return Summary._repr_html_(self) + svg_picture(
            self.uv, np.concatenate(lines or [np.zeros((0, 2, 2))]), words
        )


def flatten(
    mesh: SurfaceMesh,
    *,
    method: str = DEFAULT,
    max_seconds: float | None = None,
    max_edge_rms: float | None = None,
    avoid: ArrayLike | None = None,
    touched: ArrayLike | None = None,
    iterations: int | None = None,
    precision: str = "float64",
) -> FlatMap:
    """Lay every patch of a surface mesh flat and pack the charts.

    Parameters
    ----------
    mesh : SurfaceMesh
        Of n taxels [m].
    method : str
        One of `skinmap.flatteners()`.
    max_seconds : float, optional
        Only with `auto`: CPU time for all patches together [s].
    max_edge_rms : float, optional
        Only with `auto`: edge error that each patch should reach, 0.01 for 1 %.
    avoid : (k,) array-like of int, optional
        Taxels that seams keep away from where there is another way.
    touched : (n,) array-like of float, optional
        How often each taxel was touched (`touch_counts`): seams run where they divide few touches.
    iterations : int, optional
        Of `arap`, `balanced`, `slim` or `dirichlet`, instead of the method's own number.
    precision : {"float64", "float32"}
        Of the sparse solves of the methods that use ours; the rest is in double precision.

    Returns
    -------
    FlatMap
        A chart for each patch, with coordinates (n, 2) [m] and distortion.

    Raises
    ------
    UnknownNameError
        No such method or precision.
    InvalidArrayError
        A budget that is not positive, or with another method than `auto`; iterations or a
        precision that the method cannot have.
    FlatteningError
        A patch with a triangle without area, or one that no method lays flat without a flip.

    Examples
    --------
    >>> import skinmap
    >>> skin = skinmap.load_robot("kaspar").skin("torso")
    >>> flat = skinmap.flatten(skinmap.build_surface(skin), method="arap")
    >>> flat.charts[0].method
    'arap'
    """
    flatteners.get(method)
    check_budget(method, max_seconds, max_edge_rms)
    check_effort(method, iterations, precision)
    effort = (iterations, precision)
    away = mesh.representative[np.asarray([] if avoid is None else avoid, np.int64)]
    often = None if touched is None else check_finite(touched, "touched", (len(mesh.skin),))
    charts, weights = [], [len(mesh.patch_faces(patch)) for patch in range(mesh.n_patches)]
    for patch, weight in enumerate(weights):
        # What earlier patches left of the time, shared out by size.
        share = max_seconds and max_seconds * weight / sum(weights[patch:])
        charts.append(_flatten_patch(mesh, patch, method, away, often, share, max_edge_rms, effort))
        max_seconds = max_seconds and max(max_seconds - charts[-1].seconds, 1e-9)
    charts = _arranged(mesh, charts)
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
    avoid: IntArray,
    touched: FloatArray | None,
    max_seconds: float | None,
    max_edge_rms: float | None,
    effort: tuple[int | None, str],
) -> Chart:
    taxels, compact = np.unique(mesh.patch_faces(patch), return_inverse=True)
    faces = compact.reshape(-1, 3)
    vertices = mesh.vertices[taxels]
    where = f"patch {patch} of {mesh.skin.part!r}"
    started = time.process_time()
    check_surface(faces)
    away = np.flatnonzero(np.isin(taxels, avoid))
    often = None if touched is None else touched[taxels]
    cut = open_surface(vertices, faces, hole_share=HOLE_SHARE, avoid=away, touched=often)
    vertices, faces, taxels = vertices[cut.origin], cut.faces, taxels[cut.origin]
    flat = map_disc(
        vertices,
        faces,
        method=method,
        where=where,
        max_seconds=max_seconds,
        max_edge_rms=max_edge_rms,
        iterations=effort[0],
        precision=effort[1],
    )
    seconds = time.process_time() - started
    distortion = measure_distortion(vertices, faces, flat.uv)
    return Chart(
        patch,
        taxels,
        faces,
        flat.uv,
        distortion,
        flat.method,
        flat.fallback,
        flat.holes,
        cut.seam_length,
        seconds,
        flat.reason,
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
