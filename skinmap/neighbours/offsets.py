"""Where each taxel's neighbours lie in its own tangent plane, in frames that follow the lattice.

The radius of neighbourhoods that no taxel lies near: between two rings of the lattice.

Neighbourhoods along the skin: what lies across a fold is as far as the way round it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from skinmap.arrays import BoolArray, FloatArray, Frozen, IntArray
from skinmap.errors import InvalidArrayError
from skinmap.flat.flat_map import FlatMap
from skinmap.geometry.log_maps import log_map
from skinmap.geometry.proximity import edge_graph, median_spacing
from skinmap.geometry.rigid import tangent_frames
from skinmap.geometry.topology import half_edges
from skinmap.geometry.triangles import cross_products, pair_lengths, unit
from skinmap.surface.surface_mesh import SurfaceMesh

BAND = 0.8e-3  # half-width of the soft radius [m]: taxels this close to it are optional
FINE = 4.8e-3  # radius of lattices finer than those that this band is for [m]
LATTICE = 6  # hexagonal: directions repeat every pi / 3
LEAN = np.radians(2.0)  # a lattice that lies across by less turns to one side whatever its error


@dataclass(frozen=True, eq=False, slots=True)
class Neighbourhoods(Frozen):
    """Neighbours of n taxels within a soft radius, padded to k places.

    Attributes
    ----------
    index : (n, k) int
        Taxel in each place; -1 where there is none.
    offsets : (n, k, 2) float
        In the tangent plane, at their full 3D length [m]; 0 in empty places.
    required : (n, k) bool
        Whether a place counts for sure: not in the soft band, not empty.
    radius, band : float
        Neighbours up to radius + band count; beyond radius - band they are optional [m].
    """

    index: IntArray
    offsets: FloatArray
    required: BoolArray
    radius: float
    band: float

    def __len__(self) -> int:
        return len(self.index)

    @property
    def filled(self) -> BoolArray:
        """(n, k) places that hold a neighbour."""
        return np.asarray(self.index >= 0)

    @property
    def weight(self) -> FloatArray:
        """(n, k) how much a neighbour counts: 1, falling to 0 across the soft band."""
        length = np.linalg.norm(self.offsets, axis=2)
        return np.where(self.filled, ramp(length, self.radius, self.band), 0.0)


def _usual_band(radius: float) -> float:
    return BAND if radius >= FINE else 0.1 * radius


def ramp(length: FloatArray, radius: float, band: float) -> FloatArray:
    """Weight (...,) of neighbours at a length (...,) [m]: 1 inside the soft band, 0 outside it."""
    if band == 0.0:
        return np.where(length <= radius, 1.0, 0.0)
    return np.clip((radius + band - length) / (2.0 * band), 0.0, 1.0)


def neighbourhoods(
    points: FloatArray,
    normals: FloatArray,
    reference: FloatArray,
    *,
    radius: float,
    band: float | None = None,
) -> Neighbourhoods:
    """Neighbours of each point within a soft radius, as offsets in its tangent plane.

    Parameters
    ----------
    points, normals : (n, 3) array of float
        [m]; unit.
    reference : (n, 3) array of float
        A direction in each tangent plane that offsets are measured from (the second axis).
    radius : float
        [m].
    band : float, optional
        Neighbours up to radius + band count; beyond radius - band they are optional [m]. By default
        0.8 mm, or a tenth of a radius below 4.8 mm, which is that of a finer lattice.

    Returns
    -------
    Neighbourhoods

    Examples
    --------
    >>> import numpy as np
    >>> from skinmap.neighbours import neighbourhoods
    >>> points = np.array([[0.0, 0, 0], [5e-3, 0, 0], [0, 5e-3, 0]])
    >>> up, along = np.tile([0.0, 0, 1], (3, 1)), np.tile([0.0, 1, 0], (3, 1))
    >>> len(neighbourhoods(points, up, along, radius=8e-3))
    3
    """
    band = _usual_band(radius) if band is None else band
    pairs = cKDTree(points).query_pairs(radius + band, output_type="ndarray")
    source, target = np.concatenate([pairs, pairs[:, ::-1]]).T
    right, up = reference_frames(normals, reference)
    step = points[target] - points[source]
    flat = np.column_stack(
        [np.einsum("ij,ij->i", step, right[source]), np.einsum("ij,ij->i", step, up[source])]
    )
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return gathered(len(points), source, target, unit(flat) * length, radius=radius, band=band)


def reference_frames(normals: FloatArray, reference: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit axes (n, 3) of each tangent plane: to the right of the reference, and along it."""
    up = unit(reference - normals * np.einsum("ij,ij->i", reference, normals)[:, None])
    return np.cross(up, normals), up


def gathered(
    n: int,
    source: IntArray,
    target: IntArray,
    offsets: FloatArray,
    *,
    radius: float,
    band: float,
) -> Neighbourhoods:
    """Neighbourhoods of n taxels from pairs (p,) and the offset (p, 2) of each target [m]."""
    order = np.lexsort((target, source))
    source, target, offsets = source[order], target[order], offsets[order]
    count = np.bincount(source, minlength=n)
    place = np.arange(len(source)) - np.repeat(np.cumsum(count) - count, count)
    width = max(int(count.max(initial=0)), 1)
    index = np.full((n, width), -1)
    padded = np.zeros((n, width, 2))
    required = np.zeros((n, width), bool)
    index[source, place] = target
    padded[source, place] = offsets
    required[source, place] = np.linalg.norm(offsets, axis=1) <= radius - band
    return Neighbourhoods(index, padded, required, radius, band)


def flat_map_directions(flat: FlatMap, *, symmetry: int = LATTICE) -> FloatArray:
    """(n, 3) direction on the skin along which the flat map's second coordinate grows.

    Each chart is first turned by at most pi / symmetry so that its lattice lies along the axes:
    then structures of one patch mean the same on another. `symmetry` is 6 for triangular
    modules and hexagonal lattices, 4 for square grids.

    Parameters
    ----------
    flat : FlatMap
    Of n taxels.
    symmetry : int
    Turns of the lattice onto itself.

    Returns
    -------
    (n, 3) array of float
    Unit.

    Examples
    --------
    >>> import skinmap
    >>> from skinmap.neighbours import flat_map_directions
    >>> hand = skinmap.load_robot("kaspar").skin("right_hand")
    >>> flat = skinmap.flatten(skinmap.build_surface(hand))
    >>> flat_map_directions(flat).shape[1]
    3
    """
    if len(flat.mesh.faces) == 0:
        return tangent_frames(flat.mesh.skin.normals)[:, 1]
    directions = np.zeros((len(flat.mesh.skin), 3))
    for chart in flat.charts:
        phase = lattice_phase(chart.uv, symmetry=symmetry)
        height = chart.uv @ np.array([-np.sin(phase), np.cos(phase)])
        np.add.at(
            directions,
            chart.taxels[chart.faces.ravel()],
            np.repeat(_gradients(flat.mesh.vertices[chart.taxels], chart.faces, height), 3, axis=0),
        )
    return unit(directions)[flat.mesh.representative]


def lattice_phase(uv: FloatArray, *, symmetry: int = LATTICE) -> float:
    """Angle [rad], at most pi / symmetry in size, of the nearest steps of a lattice.

    Many patches lie just across, pi / symmetry from upright: they count as leaning to the left
    (counter-clockwise), up to `LEAN` beyond, or errors of the map would turn their frames by a
    whole step of the lattice.
    """
    limit = 1.25 * median_spacing(uv)
    pairs = cKDTree(uv).query_pairs(limit, output_type="ndarray")
    if len(pairs) == 0:
        return 0.0
    step = uv[pairs[:, 1]] - uv[pairs[:, 0]]
    angle = np.arctan2(step[:, 1], step[:, 0])
    phase = float(np.angle(np.exp(1j * symmetry * angle).sum()) / symmetry)
    return phase + 2.0 * np.pi / symmetry if phase < LEAN - np.pi / symmetry else phase


def _gradients(vertices: FloatArray, faces: IntArray, values: FloatArray) -> FloatArray:
    """(m, 3) gradient of a vertex function on each face, weighted by the area of the face."""
    normal = unit(cross_products(vertices, faces))
    corners = vertices[faces]
    opposite = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]
    return 0.5 * np.einsum("mi,mij->mj", values[faces], np.cross(normal[:, None], opposite))


def concatenate(hoods: Sequence[Neighbourhoods]) -> Neighbourhoods:
    """Neighbourhoods of several skins as one; indices count on from skin to skin.

    Raises
    ------
    InvalidArrayError
        Neighbourhoods of different radii.
    """
    radii = sorted({(hood.radius, hood.band) for hood in hoods})
    if len(radii) != 1:
        raise InvalidArrayError(f"neighbourhoods of one radius and band only, got {radii} [m]")
    width = max(hood.index.shape[1] for hood in hoods)
    index, offsets, required, start = [], [], [], 0
    for hood in hoods:
        fill = ((0, 0), (0, width - hood.index.shape[1]))
        shifted = np.where(hood.filled, hood.index + start, -1)
        index.append(np.pad(shifted, fill, constant_values=-1))
        offsets.append(np.pad(hood.offsets, (*fill, (0, 0))))
        required.append(np.pad(hood.required, fill))
        start += len(hood)
    return Neighbourhoods(
        np.concatenate(index), np.concatenate(offsets), np.concatenate(required), *radii[0]
    )


RANGE = (0.75, 1.4)  # of the requested radius: further off it is another ring's
NARROWEST, WIDEST = 1e-4, 1.0  # neighbourhoods that anyone may ask for [m]
STEPS = 261  # radii that are tried
SLACK = 0.02  # of the mean: as good as empty
MOST = 0.9  # share of the taxels that have a neighbour within a radius that is chosen


def auto_radius(skins: Sequence[FloatArray], *, near: float, band: float | None = None) -> float:
    """The middle of the widest gap in the distances between taxels, near a requested radius.

    A gap is where the fewest pairs lie in the soft band. Skins whose distances have no gap give
    the radius with the fewest pairs about it; skins without pairs give back the request.

    Parameters
    ----------
    skins : sequence of (n, 3) array of float
        Positions of the taxels of each part [m].
    near : float
        The requested radius [m].
    band : float, optional
        Half the width of the soft band [m], as in `neighbourhoods`.

    Returns
    -------
    float
    [m].

    Raises
    ------
    InvalidArrayError
        A radius that is not positive.

    Examples
    --------
    >>> import skinmap
    >>> from skinmap.neighbours import auto_radius
    >>> skin = skinmap.load_robot("icub").skin("left_forearm")
    >>> 6e-3 < auto_radius([skin.positions], near=8e-3) < 11e-3
    True
    """
    if not near > 0:
        raise InvalidArrayError(f"a radius is above 0, got {near} m")
    band = _usual_band(near) if band is None else band
    radii = near * np.linspace(*RANGE, STEPS)
    lengths, nearest = [np.zeros(0)], [np.zeros(0)]
    for points in skins:
        tree = cKDTree(points)
        pairs = tree.query_pairs(radii[-1] + band, output_type="ndarray")
        lengths.append(pair_lengths(points, pairs))
        if len(points) > 1:
            nearest.append(tree.query(points, 2)[0][:, 1])
    length, closest = np.sort(np.concatenate(lengths)), np.concatenate(nearest)
    # Below the first ring nothing lies, and nothing is known.
    ring = float(np.quantile(closest, MOST)) if len(closest) else 0.0
    count = np.searchsorted(length, radii + band) - np.searchsorted(length, radii - band)
    if not count.any():
        return near
    share = count / radii  # a ring of a random layout holds pairs in proportion to its radius
    full = radii >= (ring if ring <= radii[-1] else 0.0)
    low = np.flatnonzero(full & (share <= share[full].min() + SLACK * share.mean()))
    runs = np.split(low, np.flatnonzero(np.diff(low) > 1) + 1)
    widest = max(runs, key=lambda run: (len(run), -abs(radii[run].mean() - near)))
    return float(radii[widest].mean())


DETOUR = 1.5  # ways along edges are longer than straight ones by less


def geodesic_neighbourhoods(
    mesh: SurfaceMesh, reference: FloatArray, *, radius: float, band: float | None = None
) -> Neighbourhoods:
    """Neighbours of each taxel within a soft radius along the surface mesh.

    Lengths are exact geodesics on the mesh, directions those of the discrete exponential map.
    On flat skin both are the straight ones; taxels of another patch are no neighbours.

    Parameters
    ----------
    mesh : SurfaceMesh
    reference : (n, 3) array of float
        A direction in each tangent plane that offsets are measured from (the second axis).
    radius, band : float
        As in `neighbourhoods`.

    References
    ----------
    Mitchell, Mount and Papadimitriou, SIAM Journal on Computing 16(4), 1987, through libigl.
    """
    band = _usual_band(radius) if band is None else band
    points, normals = mesh.vertices, mesh.skin.normals
    frames = np.stack(reference_frames(normals, reference), axis=1)
    graph = edge_graph(points, half_edges(mesh.faces))
    # No way along the skin is shorter than the straight line: all neighbours are among these.
    pairs = cKDTree(points).query_pairs(radius + band, output_type="ndarray")
    source, target = np.concatenate([pairs, pairs[:, ::-1]]).T
    order = np.argsort(source, kind="stable")
    source, target = source[order], target[order]
    ends = np.searchsorted(source, np.arange(len(points) + 1))
    tree = cKDTree(points[mesh.faces].mean(axis=1)) if len(mesh.faces) else None
    longest = float(graph.data.max(initial=0.0))
    offsets = np.zeros((len(source), 2))
    length = np.full(len(source), np.inf)
    for taxel in np.flatnonzero(np.diff(ends)):
        own = slice(ends[taxel], ends[taxel + 1])
        here, there = int(mesh.representative[taxel]), mesh.representative[target[own]]
        near = [] if tree is None else tree.query_ball_point(points[here], radius + band + longest)
        length[own] = _lengths(points, mesh.faces[np.sort(near).astype(np.int64)], here, there)
        reach = DETOUR * (radius + band)
        uv, _ = log_map(points, normals, graph, here, reach, frame=frames[taxel])
        straight = (points[there] - points[here]) @ frames[taxel].T
        offsets[own] = np.where(np.isfinite(uv[there]), uv[there], straight)
    keep = length <= radius + band
    flat = unit(offsets[keep]) * length[keep, None]
    return gathered(len(points), source[keep], target[keep], flat, radius=radius, band=band)


def _lengths(points: FloatArray, faces: IntArray, here: int, there: IntArray) -> FloatArray:
    """(t,) geodesic lengths [m] over some faces from one vertex to others; inf where none leads."""
    import igl

    used, local = np.unique(faces, return_inverse=True)
    local = local.reshape(-1, 3)
    start = int(np.searchsorted(used, here))
    if start == len(used) or used[start] != here:
        return np.where(there == here, 0.0, np.inf)
    none = np.zeros(0, np.int64)
    length = igl.exact_geodesic(
        points[used], local, np.array([start]), none, np.arange(len(used)), none
    )
    length = np.where(np.isfinite(length) & (length >= 0), length, np.inf)
    length[(length == 0) & (np.arange(len(used)) != start)] = np.inf
    at = np.minimum(np.searchsorted(used, there), len(used) - 1)
    return np.where(used[at] == there, length[at], np.inf)
