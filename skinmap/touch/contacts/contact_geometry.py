"""Contact geometry: lengths, areas and counts on the skin that name a touch on any robot.

Every number is a length or area along the skin, a count or a share, so it means the same on
any lattice, patch or robot.

The shape of a contact as distances on the skin: how much of it lies how far from the rest.

Histograms of distances in millimetres do not change when a touch is turned, mirrored or shifted,
and hardly with the pitch of the taxels or with some that are dead. A ring, the jaws of a gripper
and a hand have islands alike, and differ in how far those are apart.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy.spatial.distance import pdist

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.geometry.proximity import nearest_first
from skinmap.touch.contacts.skin_geometry import ACTIVE, SkinGeometry, check_pressures, connected

MM = 1e3
CORE = 0.5  # the core of a touch: taxels with at least this share of the peak
SUMMIT = 0.4  # and a summit stands at least so high
HEAVY = 0.05  # contacts with less of the load do not count for distances
STRONGEST = 256  # taxels at most that lengths are measured on
FEATURES = (
    "active_area_mm2",
    "contacts",
    "effective_contacts",
    "length_mm",
    "width_mm",
    "largest_area_mm2",
    "largest_length_mm",
    "largest_width_mm",
    "contact_distance_mm",
    "largest_share",
    "peak",
    "mean",
    "strongest_fifth_share",
    "core_area_mm2",
    "core_length_mm",
    "core_width_mm",
    "extent_length_mm",
    "extent_width_mm",
    "filled_share",
    "summits",
    "summit_distance_mm",
    "radius_50_mm",
    "radius_90_mm",
    "border_share",
    "even_length_mm",
    "even_width_mm",
    "widest_gap_mm",
    "gaps_mm",
)


def contact_geometry(geometry: SkinGeometry, pressures: FloatArray) -> FloatArray:
    """The numbers named in `FEATURES` for pressures (n,) of 0 to 255 counts; zeros if untouched.

    Lengths are taken in the plane that keeps the path distances along the skin best (classical
    scaling), so they need no flat map. Areas count taxels at the edge of the skin in full.

    Raises
    ------
    SkinMismatchError, InvalidArrayError
        Pressures of another length than the skin, NaN or infinity.
    """
    pressures = check_pressures(pressures, geometry)
    active = pressures > ACTIVE
    index = np.flatnonzero(active)
    if len(index) == 0:
        return np.zeros(len(FEATURES))
    load = pressures[index].astype(np.float64)
    piece = connected(geometry.bridged, active, index)
    index, load, piece = strongest_taxels(index, load, piece)
    plane = skin_plane(geometry, index, load)
    areas = geometry.areas[index]
    loads = np.bincount(piece, load)
    share = loads / loads.sum()
    largest = piece == np.argmax(loads)
    core = load >= CORE * load.max()
    total = load.sum()
    whole = _spread(plane, load)
    main = _spread(plane[largest], load[largest]) if len(loads) > 1 else whole
    middle = _spread(plane[core], load[core])
    extent = plane.max(axis=0) - plane.min(axis=0) + np.sqrt(areas.mean())
    centre_distance = np.hypot(plane[:, 0], plane[:, 1])
    order = np.argsort(centre_distance, kind="stable")
    carried = load[order].cumsum() / total
    radii = centre_distance[order][carried.searchsorted((0.5, 0.9 - 1e-12))]
    strongest = np.sort(load)[::-1][: max(1, len(load) // 5)]
    summits = _summits(geometry, index, load, pressures)
    even = _spread(plane, areas)  # whatever the gains: each taxel as its skin
    gaps = _gaps(geometry, index, piece, len(loads))
    return np.array(
        [
            areas.sum() * MM**2,
            len(loads),
            1.0 / (share**2).sum(),
            *(whole * MM),
            areas[largest].sum() * MM**2,
            *(main * MM),
            _largest_gap(geometry, index, piece, load, share) * MM,
            share.max(),
            load.max(),
            load.mean(),
            strongest.sum() / total,
            areas[core].sum() * MM**2,
            *(middle * MM),
            *(extent * MM),
            areas.sum() / (extent[0] * extent[1]),
            len(summits),
            _farthest(geometry, summits) * MM,
            *(radii * MM),
            load[geometry.border[index]].sum() / total,
            *(even * MM),
            gaps.max(initial=0.0) * MM,
            gaps.sum() * MM,
        ]
    )


def skin_plane(geometry: SkinGeometry, index: IntArray, load: FloatArray) -> FloatArray:
    """(k, 2) places of taxels in the plane that keeps their paths along the skin best [m].

    Classical scaling weighted by the load: the origin is the centre of the load and the axes are
    its principal directions. Two steps of subspace iteration from the tangent plane find them.
    """
    return _plane(geometry, index.tobytes(), load.tobytes())


@lru_cache(maxsize=2)  # numbers and shape of one touch are asked one after the other
def _plane(geometry: SkinGeometry, taxels: bytes, loads: bytes) -> FloatArray:
    index, load = np.frombuffer(taxels, np.int64), np.frombuffer(loads)
    points = geometry.mesh.vertices[index]
    weight = load / load.sum()
    if len(index) == 1:
        return np.zeros((1, 2))
    squared = geometry.distances(index, index) ** 2
    row = squared @ weight
    centred = -0.5 * (squared - row[:, None] - row[None, :] + weight @ row)
    root = np.sqrt(weight)
    centred *= root[:, None] * root[None, :]
    guess = root[:, None] * ((points - weight @ points) @ _tangents(geometry, index, weight))
    basis = _orthonormal(guess)
    for _ in range(2):
        basis = _orthonormal(centred @ basis)
    small = basis.T @ (centred @ basis)
    turn = 0.5 * np.arctan2(2.0 * small[0, 1], small[0, 0] - small[1, 1])
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    size = np.sqrt(np.maximum(((small @ rotation) * rotation).sum(axis=0), 0.0))
    return np.asarray(basis @ rotation * size / root[:, None])


def _orthonormal(columns: FloatArray) -> FloatArray:
    """(k, 2) the same plane by two unit columns; zero where there is no second direction."""
    first, second = columns.T
    first = first / max(np.sqrt(first @ first), 1e-300)
    before = np.sqrt(second @ second)
    second = second - (first @ second) * first
    second -= (first @ second) * first  # once more: nearly parallel columns lose digits
    after = np.sqrt(second @ second)
    second = second / after if after > 1e-9 * before else np.zeros_like(second)
    return np.column_stack([first, second])


def _tangents(geometry: SkinGeometry, index: IntArray, weight: FloatArray) -> FloatArray:
    """(3, 2) axes across the mean normal (Duff et al., JCGT 6(1), 2017)."""
    x, y, z = (weight @ geometry.mesh.skin.normals[index]).tolist()
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = (x / length, y / length, z / length) if length > 0 else (0.0, 0.0, 1.0)
    sign = 1.0 if z >= 0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([[1.0 + sign * x * x * a, b], [sign * b, sign + y * y * a], [-sign * x, -y]])


def strongest_taxels(
    index: IntArray, load: FloatArray, piece: IntArray
) -> tuple[IntArray, FloatArray, IntArray]:
    """Taxels (k,), loads and pieces of the strongest: a pressed torso must not stop the show."""
    if len(index) <= STRONGEST:
        return index, load, piece
    keep = np.sort(np.argsort(-load, kind="stable")[:STRONGEST])
    return index[keep], load[keep], np.unique(piece[keep], return_inverse=True)[1]


def _spread(plane: FloatArray, load: FloatArray) -> FloatArray:
    """(2,) standard deviations of a load along its two principal directions [m]."""
    weight = load / load.sum()
    away = plane - weight @ plane
    (a, b), (_, c) = ((away * weight[:, None]).T @ away).tolist()
    middle, half = 0.5 * (a + c), math.hypot(0.5 * (a - c), b)
    return np.array([math.sqrt(middle + half), math.sqrt(max(middle - half, 0.0))])


def _largest_gap(
    geometry: SkinGeometry, index: IntArray, piece: IntArray, load: FloatArray, share: FloatArray
) -> float:
    """Largest path [m] between the load centres of contacts that carry 5 % or more."""
    heavy = np.flatnonzero(share >= HEAVY)
    if len(heavy) < 2:
        return 0.0
    centres = []
    for contact in heavy:
        own = piece == contact
        members = index[own]
        points, weight = geometry.mesh.vertices[members], load[own, None]
        away = points - (points * weight).sum(axis=0) / weight.sum()
        centres.append(members[nearest_first(np.linalg.norm(away, axis=1))[0]])
    return _farthest(geometry, np.array(centres))


def _gaps(geometry: SkinGeometry, index: IntArray, piece: IntArray, count: int) -> FloatArray:
    """(count - 1,) free skin between contacts [m]: the shortest links that join them all (Prim)."""
    if count < 2:
        return np.zeros(0)
    order = np.argsort(piece, kind="stable")
    starts = np.searchsorted(piece[order], np.arange(count))
    rows = index[order]
    between = np.minimum.reduceat(geometry.distances(rows, rows), starts, axis=0)
    between = np.minimum.reduceat(between, starts, axis=1)
    near, found = between[0].copy(), np.zeros(count - 1)
    near[0] = np.inf
    left = np.arange(count) > 0
    for link in range(count - 1):
        nearest = int(np.argmin(np.where(left, near, np.inf)))
        found[link], left[nearest] = near[nearest], False
        np.minimum(near, between[nearest], out=near)
    return found


def _farthest(geometry: SkinGeometry, taxels: IntArray) -> float:
    """Largest path [m] between any two of some taxels."""
    return float(geometry.distances(taxels, taxels).max()) if len(taxels) > 1 else 0.0


def _summits(
    geometry: SkinGeometry, index: IntArray, load: FloatArray, pressures: FloatArray
) -> IntArray:
    """Taxels pressed harder than all their neighbours, and with 40 % of the peak or more."""
    beside, own = geometry.beside[index], pressures[index, None]
    around = np.append(pressures, 0.0)[beside]
    # Of equals, those further down the list give way: a plateau has one summit, not many.
    beaten = (around > own) | ((around == own) & (beside < index[:, None]))
    return index[~beaten.any(axis=1) & (load >= SUMMIT * load.max())]


PAIRED = 128  # taxels at most that distances are taken between
STEP = 0.71  # between bins, of the root of a distance [mm**0.5]
PAIRS, REACH, RANKS = 20, 14, 8  # bins: to 182 mm, to 85 mm; loads by rank
SIZE = 2 * PAIRS + 5 * REACH + RANKS  # numbers of `contact_shape`
SPAN = np.linspace(0.0, 1.0, RANKS)


def contact_shape(geometry: SkinGeometry, pressures: FloatArray) -> FloatArray:
    """(118,) roots of shares of a touch by distance; zeros if untouched.

    Between any two of its taxels, by their load and by their skin; from its centre, by load, by
    skin and by the skin at the border; along its long and its short axis, by skin. Then loads by
    rank, of the largest.

    Parameters
    ----------
    geometry : SkinGeometry
        n taxels.
    pressures : (n,) float
        0 to 255 counts.

    Raises
    ------
    SkinMismatchError, InvalidArrayError
        Pressures of another length than the skin, NaN or infinity.

    Examples
    --------
    >>> import numpy as np, skinmap
    >>> from skinmap.touch.prepared_skin import PreparedSkin
    >>> skin = PreparedSkin(skinmap.load_robot("kaspar").skin("torso"))
    >>> contact_shape(skin.geometry, np.zeros(len(skin))).shape
    (118,)
    """
    pressures = check_pressures(pressures, geometry)
    index = np.flatnonzero(pressures > ACTIVE)
    if len(index) == 0:
        return np.zeros(SIZE)
    load = pressures[index].astype(np.float64)
    index, load, _ = strongest_taxels(index, load, index)
    plane = MM * skin_plane(geometry, index, load)
    return distance_shares(plane, load, geometry.areas[index] * MM**2, geometry.border[index])


def distance_shares(
    plane: FloatArray, load: FloatArray, area: FloatArray, border: BoolArray
) -> FloatArray:
    """The same of taxels (k,) by place (k, 2) [mm], load, skin [mm2], and whether it ends there."""
    # In single precision: last bits of distances differ from processor to processor.
    table = np.column_stack([plane, load, area, border]).astype(np.float32).astype(np.float64)
    if len(table) > PAIRED:
        table = table[np.sort(np.argsort(-table[:, 2], kind="stable")[:PAIRED])]
    plane, (load, area, border) = table[:, :2], table[:, 2:].T
    even, heavy = area / area.sum(), load * area / (load @ area)
    # Each pair once; a taxel with itself at no distance.
    one, other = _pairs(len(load))
    pairs = [np.append(2.0 * share[one] * share[other], share @ share) for share in (heavy, even)]
    away = plane - even @ plane
    radius, (along, across) = np.hypot(*away.T), np.abs(away.T)
    places = np.array([radius, radius, radius, along, across])
    weights = np.array([heavy, even, even * border, even, even])
    rank = np.interp(SPAN, np.arange(len(load)) / max(len(load) - 1, 1), np.sort(load))
    shares = [
        _shares(np.append(pdist(plane), 0.0)[None], np.array(pairs), PAIRS),
        _shares(places, weights, REACH),
        rank / load.max(),
    ]
    return np.asarray(np.sqrt(np.concatenate(shares)))


@lru_cache(PAIRED)
def _pairs(count: int) -> tuple[IntArray, IntArray]:
    """Both of each pair of so many, in the order of `pdist`."""
    return np.triu_indices(count, 1)


def _shares(distances: FloatArray, weights: FloatArray, bins: int) -> FloatArray:
    """(s bins,) weights (s, m) by distances (1 or s, m) [mm], each divided between two bins."""
    place = np.minimum(np.sqrt(distances) / STEP, bins - 1.001)
    low = place.astype(np.int64)
    upper = (place - low) * weights
    low = (low + bins * np.arange(len(weights))[:, None]).ravel()
    found = np.bincount(low, (weights - upper).ravel(), minlength=weights.shape[0] * bins)
    return np.asarray(found + np.bincount(low + 1, upper.ravel(), minlength=len(found)))
