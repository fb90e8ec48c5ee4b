"""Contacts: connected active taxels of the surface mesh, and the pooling of an event."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from skinmap.arrays import BoolArray, FloatArray, Frozen, IntArray
from skinmap.errors import InvalidArrayError, SkinMismatchError
from skinmap.geometry.proximity import bridged_graph, nearest, path_distances
from skinmap.geometry.topology import border_edges, edges
from skinmap.geometry.triangles import unit
from skinmap.skin.normals import along_line
from skinmap.summary import Drawable, Summary, listed
from skinmap.surface.surface_mesh import SurfaceMesh
from skinmap.surface.taxel_cloud import local_spacings

if TYPE_CHECKING:
    from skinmap.live.response.loads import ContactForce
    from skinmap.touch.load_calibration import LoadCalibration

ACTIVE = 12  # counts of 255: ten times the noise at rest; whole, as bytes are compared with it
POOL_SHARE = 0.5  # samples with at least this share of an event's largest load speak for it
BRIDGE = 24e-3  # a contact goes on across a gap between patches of at most this width [m]
# A sensor feels beyond what covers it. Of a taxel that reads at least half as much as the strongest
# of its contact, beside one that does not, this share is covered at least: 95 % of 1,972 fingers on
# a grid whose prints were measured (CapContact, Streli and Holz 2021) cover more than it gives.
HARD, RIM = 0.5, 0.2
DENSE = 2500  # taxels of a skin whose distances are kept as one table (25 MB)


@dataclass(frozen=True, eq=False)
class SkinGeometry(Frozen):
    """What contacts on a skin are measured with: links, areas and distances along it.

    Attributes
    ----------
    mesh : SurfaceMesh
    links : (e, 2) int
        Pairs of taxels, in both directions, that belong to one contact when both are active:
        mesh edges, merged taxels and, on a skin that closes to a ring, what faces across a joint.
    bridged : (b, 2) int
        The same and facing taxels on both sides of a gap between patches.
    areas : (n,) float
        Skin area that each taxel speaks for [m2]; at the edge of the skin as much as inside.
    border : (n,) bool
        Taxels on the edge of a patch.
    graph : (n, n) sparse
        Steps along the skin and their lengths [m], straight across the gaps between patches.
    """

    mesh: SurfaceMesh
    links: IntArray
    bridged: IntArray
    areas: FloatArray
    border: BoolArray
    graph: csr_array
    _table: list[NDArray[np.float32]] = field(default_factory=list, repr=False)

    def __len__(self) -> int:
        return len(self.areas)

    @cached_property
    def beside(self) -> IntArray:
        """(n, d) taxels beside each, as `bridged` has them, padded with n."""
        return padded_neighbours(self.bridged, len(self))

    def distances(self, rows: IntArray, columns: IntArray) -> FloatArray:
        """(r, c) shortest paths along the skin between taxels [m].

        Up to `DENSE` taxels all paths are kept once asked for; beyond, they are found anew.
        """
        if len(self) > DENSE:
            return path_distances(self.graph, rows)[:, columns]
        if not self._table:
            self._table.append(path_distances(self.graph).astype(np.float32))
        return self._table[0].take(rows, axis=0).take(columns, axis=1).astype(np.float64)


def measure_skin(mesh: SurfaceMesh) -> SkinGeometry:
    """Links, areas and distances of a surface mesh with n taxels, made once per skin.

    Parameters
    ----------
    mesh : SurfaceMesh
    With n taxels.

    Returns
    -------
    SkinGeometry

    Examples
    --------
    >>> import skinmap
    >>> from skinmap.touch import measure_skin
    >>> mesh = skinmap.build_surface(skinmap.load_robot("kaspar").skin("right_hand"))
    >>> geometry = measure_skin(mesh)
    >>> bool((geometry.areas >= 0).all())
    True
    """
    points, spacing = mesh.vertices, mesh.skin.spacing
    near = nearest(points, 1)[0][:, 0] if len(points) > 1 else np.full(len(points), spacing)
    pitch = local_spacings(points, mesh.skin.normals, near, spacing)
    # Two rings of neighbours: paths over one ring alone are up to 15 % too long on hexagons.
    graph = bridged_graph(points, 18, 2.5 * pitch)
    merged = np.flatnonzero(mesh.representative != np.arange(len(points)))
    same = np.column_stack([merged, mesh.representative[merged]])
    border = border_taxels(mesh)
    pairs = edges(mesh.faces)
    if len(mesh.faces) == 0 and len(points) > 1:  # taxels in a row
        order, along = np.argsort(along_line(points)), np.sort(along_line(points))
        pairs = np.column_stack([order[:-1], order[1:]])[np.diff(along) <= BRIDGE]
    links = np.concatenate([pairs, same])
    bridged = np.concatenate([links, _facing(mesh, border)])
    if mesh.skin.ring:
        links = bridged
    areas = _full_cells(mesh, border, np.clip(near, spacing, pitch))
    return SkinGeometry(mesh, _both_ways(links), _both_ways(bridged), areas, border, graph)


def padded_neighbours(pairs: IntArray, count: int) -> IntArray:
    """(count, d) the second of all pairs (e, 2), sorted by their first; padded with count."""
    one, other = pairs.T
    degree = np.bincount(one, minlength=count)
    table = np.full((count, max(int(degree.max(initial=0)), 1)), count)
    place = np.arange(len(one)) - np.repeat(np.cumsum(degree) - degree, degree)
    table[one, place] = other
    return table


def _both_ways(pairs: IntArray) -> IntArray:
    """Each pair in both directions, once and sorted: a part of them is a sparse matrix at once."""
    return np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)


def border_taxels(mesh: SurfaceMesh) -> BoolArray:
    """(n,) whether each taxel lies on the edge of its patch (or in no triangle)."""
    taxels = np.arange(len(mesh.skin))
    border = np.isin(taxels, border_edges(mesh.faces)) | ~np.isin(taxels, mesh.faces)
    return np.asarray(border[mesh.representative])


def _full_cells(mesh: SurfaceMesh, border: BoolArray, pitch: FloatArray) -> FloatArray:
    """Areas (n,) [m2] where a taxel at the edge stands for as much skin as the typical one inside.

    Its triangles cover half of that or less, and a touch there would seem smaller than it is. In
    coarser areas, by their pitch (n,) [m], the typical one is larger.
    """
    areas, scale = mesh.taxel_areas, (pitch / pitch.min()) ** 2
    inside = (areas / scale)[~border] if (~border).any() else areas / scale
    return np.where(border, np.maximum(areas, np.median(inside) * scale), areas)


def _facing(mesh: SurfaceMesh, border: BoolArray) -> IntArray:
    """Pairs (g, 2) of taxels on both sides of a gap between patches, each other's nearest."""
    patch = mesh.taxel_patches
    rims = [np.flatnonzero(border & (patch == k)) for k in range(mesh.n_patches)]
    trees = [cKDTree(mesh.vertices[rim]) for rim in rims]
    found = [np.zeros((0, 2), np.int64)]
    for a in range(len(rims)):
        for b in range(len(rims)):
            if a == b or len(rims[a]) == 0 or len(rims[b]) == 0:
                continue
            gap, near = trees[b].query(mesh.vertices[rims[a]], distance_upper_bound=BRIDGE)
            close = np.isfinite(gap)
            found.append(np.column_stack([rims[a][close], rims[b][near[close]]]))
    pairs = np.concatenate(found)
    # Back and front of a thin part are near, too, but face away from each other.
    normals = unit(np.asarray(mesh.skin.normals))
    together = np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) > 0.0
    return pairs[together]


def least_areas(
    index: IntArray, pressures: FloatArray, peaks: FloatArray, beside: IntArray, areas: FloatArray
) -> FloatArray:
    """(k,) the skin [m2] of each of some taxels that its contact covers at least.

    Parameters
    ----------
    index : (k,) int
        Active taxels of n.
    pressures, peaks : (k,) float
        Of each, and the largest of its contact [counts].
    beside : (n, d) int
        Taxels beside each, padded with n.
    areas : (n,) float
        Of all taxels [m2].
    """
    hard, around = np.zeros(len(areas) + 1, bool), beside[index]
    strong = pressures >= HARD * peaks
    hard[index[strong]] = hard[-1] = True
    inner = hard[around].all(axis=1) & (around < len(areas)).any(axis=1)
    return np.asarray(areas[index] * strong * np.where(inner, 1.0, RIM))


def pressed(samples: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The samples (j, n) of an event (k, n) that carry at least half of its largest load.

    Landing and leaving say little of a touch; no sample is left where nothing is active.
    """
    load = np.where(samples > ACTIVE, samples, 0).sum(axis=1, dtype=np.float64)
    if len(load) == 0 or load.max() == 0:
        return samples[:0]
    return samples[load >= POOL_SHARE * load.max()]


def pool_event(samples: NDArray[np.uint8]) -> FloatArray:
    """One pressure (n,) per taxel for the samples (k, n) of an event: the mean while pressed."""
    found, columns = np.zeros(samples.shape[1]), np.flatnonzero(samples.max(axis=0, initial=0))
    held = pressed(samples[:, columns])
    if len(held):
        found[columns] = held.mean(axis=0)
    return found


def check_pressures(pressures: ArrayLike, geometry: SkinGeometry) -> NDArray[Any]:
    """Pressures (n,) of one sample, or (t, n) of several, for the taxels of this skin.

    Raises
    ------
    SkinMismatchError
        Pressures of another length than the skin.
    InvalidArrayError
        NaN or infinity (names the taxel), or what is not numbers.
    """
    array = np.asarray(pressures)
    if array.ndim not in (1, 2) or array.shape[-1] != len(geometry):
        raise SkinMismatchError(
            f"{array.shape[-1] if array.ndim else array.size} pressures for the {len(geometry)} "
            f"taxels of {geometry.mesh.skin.part!r}"
        )
    if array.dtype.kind not in "biuf":
        raise InvalidArrayError(f"pressures must be numbers, not {array.dtype}")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        taxel = int(np.argwhere(~np.isfinite(array))[0, -1])
        raise InvalidArrayError(f"pressures hold NaN or infinity, first at taxel {taxel}")
    return array


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Contact(Summary):
    """A connected piece of active taxels.

    Attributes
    ----------
    taxels : (k,) int
        Its taxels, rows of the skin.
    centre : (3,) float
        Mean of their positions, each weighted by its pressure, in the link's frame [m].
    area, area_least : float
        Skin under them, which feels the contact, and the least of it that is covered [m2].
    peak, mean : float
        Largest and mean pressure [counts].
    load : ContactForce or None
        Force, area, moment and pressures with intervals, where a calibration was given.
    """

    taxels: IntArray
    centre: FloatArray
    area: float
    peak: float
    mean: float
    load: ContactForce | None = None
    area_least: float = float("nan")

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "taxels": len(self.taxels),
            "area": f"{1e6 * self.area_least:.0f} to {1e6 * self.area:.0f} mm2",
            "peak": f"{self.peak:.0f}",
        } | ({} if self.load is None else {"force": self.load.in_words()})


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Contacts(Drawable, Sequence[Contact]):
    """Contacts of one sample, the one with the largest load first.

    Attributes
    ----------
    geometry : SkinGeometry
        Of n taxels.
    pressures : (n,) float
        Of the sample [counts].
    number : (n,) int
        Contact of each taxel; -1 where it is not active.
    weigh : callable or None
        Force of the contact on some taxels (k,), where a calibration was given.
    """

    FIGURE: ClassVar = "skinmap.report.touch_figures:contacts_figure"
    FORCES: ClassVar = "skinmap.live.response.loads"  # where `contact_loads` is found
    geometry: SkinGeometry
    pressures: NDArray[Any]
    number: IntArray
    weigh: Callable[[IntArray], ContactForce] | None = None

    def __len__(self) -> int:
        return int(self.number.max(initial=-1)) + 1

    @overload
    def __getitem__(self, index: int) -> Contact: ...
    @overload
    def __getitem__(self, index: slice) -> list[Contact]: ...
    def __getitem__(self, index: int | slice) -> Contact | list[Contact]:
        if isinstance(index, slice):
            return [self[k] for k in range(len(self))[index]]
        taxels = np.flatnonzero(self.number == range(len(self))[index])
        felt = np.asarray(self.pressures[taxels], np.float64)
        centre = np.average(self.geometry.mesh.vertices[taxels], 0, felt / felt.max())
        beside, areas = self.geometry.beside, self.geometry.areas
        least = float(least_areas(taxels, felt, felt.max(), beside, areas).sum())
        area = float(areas[taxels].sum())
        load = None if self.weigh is None else self.weigh(taxels)
        return Contact(taxels, centre, area, float(felt.max()), float(felt.mean()), load, least)

    @property
    def active(self) -> BoolArray:
        """(n,) whether each taxel is active."""
        return np.asarray(self.number >= 0)

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        areas = [f"{1e6 * one.area:.0f} mm2" for one in self]
        return {
            "part": self.geometry.mesh.skin.part,
            "contacts": len(self),
            "areas": listed(areas),
        }


def find_contacts(
    surface: SurfaceMesh | SkinGeometry,
    pressures: ArrayLike,
    *,
    calibration: LoadCalibration | None = None,
) -> Contacts:
    """Connected pieces of active taxels on a skin in one sample.

    Parameters
    ----------
    surface : SurfaceMesh or SkinGeometry
        Of n taxels. Measure a mesh once where many samples follow: `skinmap.touch.measure_skin`.
    pressures : (n,) array-like
        0 to 255 [counts]; above 12 a taxel is active.
    calibration : LoadCalibration, optional
        `LoadCalibration.read` of what `skinmap calibrate load` wrote. `pressures` are then raw
        counts as they were calibrated, and each contact has a `load` in newtons.

    Returns
    -------
    Contacts
        A sequence, the largest load first; `number` holds the contact of each taxel.

    Raises
    ------
    SkinMismatchError
        Pressures of another length than the skin.
    InvalidArrayError
        NaN or infinity (names the taxel).

    Examples
    --------
    >>> import skinmap
    >>> mesh = skinmap.build_surface(skinmap.load_robot("kaspar").skin("left_hand"))
    >>> pressures = [0] * len(mesh.skin)
    >>> pressures[3] = 200
    >>> found = skinmap.find_contacts(mesh, pressures)
    >>> len(found), found[0].taxels.tolist()
    (1, [3])
    """
    geometry = measure_skin(surface) if isinstance(surface, SurfaceMesh) else surface
    pressures = check_pressures(pressures, geometry)
    if pressures.ndim != 1:
        raise InvalidArrayError(
            f"find_contacts takes one sample ({len(geometry)},), not {len(pressures)} samples"
        )
    weigh = None
    if calibration is not None:
        loads = importlib.import_module(Contacts.FORCES)
        weigh = loads.contact_loads(geometry.mesh, calibration, pressures)
        pressures = calibration.above_rest(pressures)
    active = pressures > ACTIVE
    label = np.full(len(pressures), -1)
    index = np.flatnonzero(active)
    if len(index):
        piece = connected(geometry.bridged, active, index)
        # Scaled first: sums of huge numbers overflow.
        load = np.bincount(piece, pressures[index] / pressures[index].max())
        rank = np.argsort(np.argsort(-load, kind="stable"))
        label[index] = rank[piece]
    return Contacts(geometry, pressures, label, weigh)


def connected(links: IntArray, active: BoolArray, index: IntArray) -> IntArray:
    """(k,) connected piece of each active taxel, whose rows `index` (k,) gives; 0 first."""
    links = links[active[links[:, 0]] & active[links[:, 1]]]
    place = np.empty(len(active), np.int64)
    place[index] = np.arange(len(index))
    return pieces(place[links[:, 0]], place[links[:, 1]], len(index))


def pieces(one: IntArray, other: IntArray, count: int) -> IntArray:
    """(count,) piece of each of some nodes that links (e,), (e,) in both directions join.

    Every node takes the least label among its neighbours, and so does the node whose label it
    bore; labels then jump to their labels' labels. For the few taxels of a touch this is several
    times quicker than building a sparse matrix. (Zhang, Azad and Hu, "FastSV", SIAM PP 2020.)
    """
    label = np.arange(count)
    while True:
        low = label[other]
        new = label.copy()
        np.minimum.at(new, one, low)
        np.minimum.at(new, label[one], low)
        new = new[new]
        if (new == label).all():
            break
        label = new
    rank = np.cumsum(label == np.arange(count)) - 1  # of the roots, which bear their own label
    return rank[label]
