"""Flat maps: every patch of a surface mesh laid in the plane, with its distortion."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from skinmap.arrays import FloatArray, Frozen, IntArray, check_finite
from skinmap.errors import FlatteningError, InvalidArrayError, SkinWarning
from skinmap.flat.atlas import Laid, arrange, limb_frame, turn_upright
from skinmap.flat.dirichlet import at_best_size, symmetric_dirichlet_descent
from skinmap.flat.disc import Disc
from skinmap.flat.distortion import Distortion, edge_rms, measure_distortion
from skinmap.flat.methods import (
    DEFAULT,
    HOLE_SHARE,
    DiscMap,
    check_budget,
    check_effort,
    flatten_disc,
    flatteners,
    map_disc,
)
from skinmap.flat.periodic import periodic_map, tube_rims
from skinmap.flat.seam_choice import Divided, add_seams, seam_of_touches
from skinmap.flat.seams import CutMesh, SeamPrice, open_surface, rims_and_holes, touch_counts
from skinmap.geometry.raster import enclosing_triangles
from skinmap.geometry.topology import check_surface, edges, loops_by_length
from skinmap.geometry.triangles import signed_areas
from skinmap.skin.normals import along_line
from skinmap.skin.skin import svg_picture
from skinmap.summary import Drawable, Summary, listed
from skinmap.surface.surface_mesh import SurfaceMesh

STRETCHING = ("tutte", "harmonic", "lscm", "bff", "fast")  # methods that do not keep lengths
STRETCHED, SLIT = 0.5, 4.5  # error of edges that is warned of, and the energy that mends it
BULGE, WORTH = 0.2, 0.02  # curvature of a rim [rad], and the edge error that a seam to it saves
UNCUT = 1e-3  # edge error that closing a seam may add
ISOMETRY = 4.0  # symmetric Dirichlet energy of a map without distortion

__all__ = ["DEFAULT", "HOLE_SHARE", "Chart", "FlatMap", "flatten", "flatten_disc"]


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Chart(Frozen, Summary):
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
        Packed beside the other charts, of the area of the skin [m].
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
    periodic : bool
        Whether this is a tube laid flat uncut: the map repeats itself beyond its two sides, and
        the two places of a taxel there are one `period` apart.
    divided : Divided, optional
        What its seam divides, where it was chosen by touches.
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
    periodic: bool = False
    divided: Divided | None = None

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "patch": self.patch,
            "taxels": len(self.taxels),
            "method": self.method,
            "edge_rms": f"{self.distortion.edge_rms:.2%}",
            "flips": self.distortion.flips,
        }

    @property
    def period(self) -> FloatArray | None:
        """(2,) after which a periodic map repeats itself [m]; None for others."""
        if not self.periodic:
            return None
        order = np.argsort(self.taxels, kind="stable")
        again = np.flatnonzero(np.diff(self.taxels[order]) == 0)
        steps = self.uv[order[again + 1]] - self.uv[order[again]]
        return np.asarray((steps * np.sign(steps @ steps[0])[:, None]).mean(axis=0))


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class FlatMap(Frozen, Drawable):
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

    FIGURE: ClassVar = "skinmap.report.flat_figures:part_figure"
    mesh: SurfaceMesh
    charts: tuple[Chart, ...]
    uv: FloatArray

    @property
    def flips(self) -> int:
        """Triangles turned over, all charts together."""
        return sum(chart.distortion.flips for chart in self.charts)

    def on_body(self, points: ArrayLike) -> FloatArray:
        """Where points of the map lie on the body, in the frame of its link.

        The inverse of the map, linear in each of its triangles: vertices of a chart come back to
        their taxels.

        Parameters
        ----------
        points : (p, 2) array-like of float
            Map coordinates [m].

        Returns
        -------
        (p, 3) array of float
            Positions [m]; NaN for points beside the map.

        Raises
        ------
        InvalidArrayError
            Points that are not finite, or not of two coordinates.

        Examples
        --------
        >>> import numpy as np
        >>> import skinmap
        >>> skin = skinmap.load_robot("kaspar").skin("left_hand")
        >>> flat = skinmap.flatten(skinmap.build_surface(skin))
        >>> bool(np.allclose(flat.on_body(flat.uv), skin.positions))
        True
        """
        wanted = check_finite(points, "points of the map", (None, 2))
        found = np.full((len(wanted), 3), np.nan)
        for chart in self.charts:
            if len(chart.faces) == 0:
                continue
            face, weights = enclosing_triangles(chart.uv, chart.faces, wanted)
            inside = np.flatnonzero(face >= 0)
            corners = self.mesh.vertices[chart.taxels[chart.faces[face[inside]]]]
            found[inside] = np.einsum("pc,pcd->pd", weights[inside], corners)
        return found

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
        return super(FlatMap, self)._repr_html_() + svg_picture(
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
    touches: Sequence[ArrayLike] | None = None,
    cuts: ArrayLike | None = None,
    periodic: bool = False,
    max_distortion: float | None = None,
    iterations: int | None = None,
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
        Only with `auto`: edge error that each patch should reach, root mean square
        of all edges [%].
    avoid : (k,) array-like of int, optional
        Taxels that seams keep away from where there is another way.
    touched : (n,) array-like of float, optional
        How often each taxel was touched (`touch_counts`): seams run where they divide few touches.
    touches : sequence of (k,) array-like of int, optional
        Taxels of each touch. Of several seams the one is taken that divides fewest of them, where
        that saves touches not used for choosing too, for at most 0.5 points of edge error.
    cuts : (c, 2) array-like of int, optional
        Taxels at the ends of edges that are cut; what is no disc then is cut further.
    periodic : bool
        Lay tubes flat uncut, as maps that repeat themselves (method "periodic").
    max_distortion : float, optional
        Slit each chart until its mean symmetric Dirichlet energy is at most this, above 4.
    iterations : int, optional
        Of `arap`, `balanced`, `slim` or `dirichlet`, instead of the method's own number.

    Returns
    -------
    FlatMap
        A chart for each patch, with coordinates (n, 2) [m] and distortion.

    Raises
    ------
    UnknownNameError
        No such method.
    InvalidArrayError
        A budget that is not positive, or with another method than `auto`; iterations
        that the method cannot have; taxels that the mesh has not.
    FlatteningError
        A patch with a triangle without area, or one that no method lays flat without a flip;
        `periodic` and a patch that is neither a disc nor a tube.

    Examples
    --------
    >>> import skinmap
    >>> skin = skinmap.load_robot("kaspar").skin("torso")
    >>> flat = skinmap.flatten(skinmap.build_surface(skin), method="arap")
    >>> flat.charts[0].method
    'arap'
    """
    flatteners.get(method)
    check_budget(method, {"max_seconds": max_seconds, "max_edge_rms": max_edge_rms})
    check_effort(method, iterations)
    if max_distortion is not None and not max_distortion > ISOMETRY:
        raise InvalidArrayError(f"max_distortion must be above {ISOMETRY:g}, got {max_distortion}")
    cutting = _Cutting(
        _taxels_of(mesh, avoid, "avoid"),
        None if touched is None else check_finite(touched, "touched", (len(mesh.skin),)),
        None if touches is None else [_taxels_of(mesh, one, "touches") for one in touches],
        _taxels_of(mesh, cuts, "cuts", 2).reshape(-1, 2),
        periodic,
        max_distortion,
    )
    if len(mesh.faces) == 0:
        return _lone_taxels(mesh, method)
    how: dict[str, Any] = {"method": method, "iterations": iterations}
    how["max_edge_rms"] = max_edge_rms and max_edge_rms / 100.0
    charts, weights = [], [len(mesh.patch_faces(patch)) for patch in range(mesh.n_patches)]
    for patch, weight in enumerate(weights):
        # What earlier patches left of the time, shared out by size.
        how["max_seconds"] = max_seconds and max_seconds * weight / sum(weights[patch:])
        charts.append(_flatten_patch(mesh, patch, cutting, how))
        max_seconds = max_seconds and max(max_seconds - charts[-1].seconds, 1e-9)
    if words := mesh.left_out():
        words += "; they have no place on the map"
        warnings.warn(f"{mesh.skin.part!r}: {words}", SkinWarning, stacklevel=2)
    charts = _arranged(mesh, charts)
    uv = np.full((len(mesh.skin), 2), np.nan)
    for chart in charts:
        uv[chart.taxels] = chart.uv
    return FlatMap(mesh, tuple(charts), uv[mesh.representative])


def _taxels_of(mesh: SurfaceMesh, taxels: ArrayLike | None, name: str, each: int = 1) -> IntArray:
    """The vertices of some taxels that the user names, `each` of them in a row."""
    found, last = np.asarray([] if taxels is None else taxels), len(mesh.skin) - 1
    if found.size % each or (
        found.size and (found.dtype.kind not in "iu" or found.min() < 0 or found.max() > last)
    ):
        shape = " in pairs" * (each == 2)
        raise InvalidArrayError(f"{name} must hold numbers of taxels{shape}, 0 to {last}")
    return mesh.representative[found.astype(np.int64)]


def _lone_taxels(mesh: SurfaceMesh, method: str) -> FlatMap:
    """The map of taxels in a row, or of a single one: as far apart as they are."""
    n, along = len(mesh.skin), along_line(mesh.vertices)
    uv = np.column_stack([along, np.zeros(n)])
    uv -= uv.mean(axis=0)
    one, ends = np.ones(1), np.array([[along.argmin(), along.argmax()]])
    length = np.array([mesh.skin.spacing])
    true = Distortion(  # an isometry
        one, one, ISOMETRY * one, one, one, 0 * one, 0 * one, length, ends, mesh.taxel_areas[:1], 0
    )  # fmt: skip
    chart = Chart(0, np.arange(n), mesh.faces, uv, true, method, False, 0, 0.0, 0.0)
    return FlatMap(mesh, (chart,), uv)


@dataclass(frozen=True, eq=False, slots=True)
class _Cutting:
    """How patches are opened, in taxels: the keywords of `flatten`."""

    avoid: IntArray
    touched: FloatArray | None
    touches: Sequence[IntArray] | None
    cuts: IntArray
    periodic: bool
    max_distortion: float | None


@dataclass(frozen=True, eq=False, slots=True)
class _Opened:
    """A patch opened and laid flat."""

    cut: CutMesh
    flat: DiscMap
    divided: Divided | None = None
    periodic: bool = False


def _flatten_patch(
    mesh: SurfaceMesh, patch: int, cutting: _Cutting, how: Mapping[str, Any]
) -> Chart:
    taxels, compact = np.unique(mesh.patch_faces(patch), return_inverse=True)
    faces = compact.reshape(-1, 3)
    vertices = mesh.vertices[taxels]
    where = f"patch {patch} of {mesh.skin.part!r}"
    started = time.process_time()
    check_surface(faces)
    how = {**how, "where": where}
    asked = np.isin(cutting.cuts, taxels).all(axis=1).any()
    opened = (
        (None if asked else _uncut(vertices, faces, cutting, how))
        or (_rolled_out(vertices, faces, where) if cutting.periodic else None)
        or _opened(vertices, faces, taxels, cutting, how)
    )
    seconds = time.process_time() - started
    cut, flat = opened.cut, opened.flat
    distortion = measure_distortion(vertices[cut.origin], cut.faces, flat.uv)
    # Conformal maps keep the length of the border, not the size of the skin.
    size = np.sqrt(distortion.face_areas.sum() / signed_areas(flat.uv, cut.faces).sum())
    keeps = flat.method not in STRETCHING and cutting.max_distortion is None
    if keeps and distortion.edge_rms > STRETCHED:
        warnings.warn(
            f"{where} is stretched by {distortion.edge_rms:.0%} (edges, rms): a max-distortion of "
            f"{SLIT:g} slits it further",
            SkinWarning,
            stacklevel=4,
        )
    return Chart(
        patch,
        taxels[cut.origin],
        cut.faces,
        size * flat.uv,
        distortion,
        flat.method,
        flat.fallback,
        flat.holes,
        cut.seam_length,
        seconds,
        flat.reason,
        opened.periodic,
        opened.divided,
    )


def _uncut(
    vertices: FloatArray, faces: IntArray, cutting: _Cutting, how: Mapping[str, Any]
) -> _Opened | None:
    """A patch with wide holes that lies flat as it is; None for what a seam helps, and for discs.

    Cut open and laid flat, both sides of its seams nearly meet: they become one again.
    """
    n_rims = len(rims_and_holes(vertices, faces, HOLE_SHARE)[0])
    # What fills a rim that is cut out of a flat patch has no curvature; of a tube, 2 pi.
    if n_rims < 2 or len(rims_and_holes(vertices, faces, np.inf, BULGE)[0]) > 1:
        return None
    cut = open_surface(vertices, faces, hole_share=HOLE_SHARE)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SkinWarning)
        flat = map_disc(vertices[cut.origin], cut.faces, **how)
    copies = np.bincount(cut.origin)
    uv = np.column_stack([np.bincount(cut.origin, one) / copies for one in flat.uv.T])
    loops = loops_by_length(vertices, faces)
    disc = Disc(vertices, faces, loops[0])
    if flat.fallback or not disc.is_injective(uv):
        return None
    uv = symmetric_dirichlet_descent(disc, at_best_size(disc, uv))
    found = measure_distortion(vertices, faces, uv)
    most = edge_rms(vertices[cut.origin], cut.faces, flat.uv) + UNCUT
    bent = found.edge_rms > most or found.mean_energy > (cutting.max_distortion or np.inf)
    if bent or disc.overlaps(uv):
        return None
    whole = CutMesh(faces, np.arange(len(vertices)), 0.0)
    divided = cutting.touches and Divided(len(cutting.touches), 0, 0, float("nan"))
    return _Opened(whole, replace(flat, uv=uv, holes=len(loops) - 1), divided or None)


def _rolled_out(vertices: FloatArray, faces: IntArray, where: str) -> _Opened | None:
    """A tube as a map that repeats itself; None for a disc, which needs no seam.

    Raises
    ------
    FlatteningError
        A patch that is neither.
    """
    rims = tube_rims(vertices, faces, HOLE_SHARE)
    if rims is not None:
        laid = periodic_map(vertices, faces, rims, hole_share=HOLE_SHARE, where=where)
        return _Opened(*laid, periodic=True)
    if open_surface(vertices, faces, hole_share=HOLE_SHARE).seam_length > 0.0:
        raise FlatteningError(
            f"{where} is not a tube: without a seam only tubes and discs lie flat"
        )
    return None


def _opened(
    vertices: FloatArray,
    faces: IntArray,
    taxels: IntArray,
    cutting: _Cutting,
    how: Mapping[str, Any],
) -> _Opened:
    """A patch cut open as it should be, then laid flat."""

    def lay_flat(points: FloatArray, triangles: IntArray, **more: Any) -> DiscMap:
        return map_disc(points, triangles, **how, **more)

    def tried(points: FloatArray, triangles: IntArray) -> DiscMap:
        with warnings.catch_warnings():  # of maps that are not taken nobody wants to know
            warnings.simplefilter("ignore", SkinWarning)
            return lay_flat(points, triangles, may_overlap=True)

    def edge_error(cut: CutMesh) -> float:
        own = vertices[cut.origin]
        return edge_rms(own, cut.faces, tried(own, cut.faces).uv)

    away = np.flatnonzero(np.isin(taxels, cutting.avoid))
    often = None if cutting.touched is None else cutting.touched[taxels]
    own = cutting.cuts[np.isin(cutting.cuts, taxels).all(axis=1)]
    bulge = np.inf if cutting.periodic else _bulge(vertices, faces, edge_error)
    opening: dict[str, Any] = {"hole_share": HOLE_SHARE, "bulge": bulge, "avoid": away}
    divided = None
    if cutting.touches is not None:
        touches = [np.searchsorted(taxels, t[np.isin(t, taxels)]) for t in cutting.touches]
        cut, divided = seam_of_touches(vertices, faces, touches, edge_error, **opening)
        often = touch_counts(touches, len(taxels))
    else:
        along = np.searchsorted(taxels, own)
        cut = open_surface(vertices, faces, touched=often, along=along, **opening)
    if cutting.max_distortion is None:
        return _Opened(cut, lay_flat(vertices[cut.origin], cut.faces), divided)
    price = SeamPrice(vertices, away, often).of
    cut = add_seams(vertices, cut, tried, cutting.max_distortion, price)
    flat = lay_flat(vertices[cut.origin], cut.faces)
    found = measure_distortion(vertices[cut.origin], cut.faces, flat.uv)
    if (energy := found.mean_energy) > cutting.max_distortion:
        warnings.warn(
            f"{how['where']}: seams bring the mean symmetric Dirichlet energy to {energy:.4g}, not "
            f"to {cutting.max_distortion:g}",
            SkinWarning,
            stacklevel=4,
        )
    return _Opened(cut, flat, divided)


def _bulge(vertices: FloatArray, faces: IntArray, error: Callable[[CutMesh], float]) -> float:
    """`BULGE` where seams to rims as short as holes save edge error; else infinity: all are filled.

    Trials are for what has such rims: maps of all others cost what they did.
    """
    filled, cut = (rims_and_holes(vertices, faces, HOLE_SHARE, one)[0] for one in (np.inf, BULGE))
    if len(filled) == len(cut):
        return np.inf
    before, after = (
        error(open_surface(vertices, faces, hole_share=HOLE_SHARE, bulge=one))
        for one in (np.inf, BULGE)
    )
    return BULGE if after < before - WORTH else np.inf


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
