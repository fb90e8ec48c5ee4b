"""What comes in, checked at the border: layouts, links, anchors, and units that were mixed up."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import pdist

from calibration.patch.sheet_model import Evidence, at_taxels
from skinmap.arrays import (
    FloatArray,
    IntArray,
    check_faces,
    check_finite,
    check_points,
    check_whole,
)
from skinmap.errors import InvalidArrayError, InvalidMeshError
from skinmap.geometry.proximity import closest_on_mesh, median_spacing
from skinmap.summary import first_few

FEWEST = 3
UNITS = {1e-3: "millimetres", 1e-2: "centimetres", 0.0254: "inches"}  # beside metres
RATIO = (0.5, 1.6)  # anchors' distances against the layout's: bent lengths are shorter
IN_A_ROW = 0.05  # second singular value of the anchors against the first
FAR = 0.03  # anchors lie on the cover, not further than this from the link [m]
LISTED = 8  # channels that a message names
PITCH = (0.3e-3, 60e-3)  # of taxels on any board that one would wrap [m]

Link = tuple[FloatArray, IntArray]


def check_layout(layout: ArrayLike) -> FloatArray:
    """A layout (n, 2) [m] of at least three taxels, no two in one place."""
    points = check_finite(layout, "layout", (None, 2))
    if len(points) < FEWEST:
        raise InvalidArrayError(f"a layout needs at least {FEWEST} taxels, got {len(points)}")
    _, first, count = np.unique(points, axis=0, return_index=True, return_counts=True)
    if (count > 1).any():
        row = int(first[count > 1][0])
        raise InvalidArrayError(f"two taxels of the layout share the place of row {row}")
    if in_a_row(points, 0.1 * IN_A_ROW):
        raise InvalidArrayError(
            f"the {len(points)} taxels of the layout lie in a row: a line could turn about itself"
        )
    pitch = median_spacing(points)
    if not PITCH[0] <= pitch <= PITCH[1]:
        hint = [
            f"; is it in {name}? Multiply all lengths by {factor:g}"
            for unit, other in UNITS.items()
            for factor, name in ((unit, other), (1.0 / unit, f"metres, not {other}"))
            if PITCH[0] <= pitch * factor <= PITCH[1]
        ]
        raise InvalidArrayError(
            f"the taxels of the layout are {pitch:.3g} m apart, expected {PITCH[0]:g} to "
            f"{PITCH[1]:g} m{hint[0] if hint else ''}"
        )
    return points


def check_names(names: ArrayLike, kind: str, count: int) -> IntArray:
    """A whole number (n,) for each of so many taxels: their "modules", or "channels"."""
    numbers = check_whole(names, kind)
    if len(numbers) != count:
        raise InvalidArrayError(f"{len(numbers)} {kind} for a layout of {count} taxels")
    return numbers


def check_link(vertices: ArrayLike, faces: ArrayLike) -> Link:
    """A link's mesh with at least one triangle."""
    points = check_points(vertices, "vertices")
    triangles = check_faces(faces, len(points))
    if len(triangles) == 0:
        raise InvalidMeshError("the link's mesh has no triangles: nothing to lay a patch on")
    return points, triangles


def check_anchors(
    layout: FloatArray,
    link: Link,
    indices: ArrayLike,
    points: ArrayLike,
    sigma: ArrayLike,
    names: IntArray,
) -> Evidence:
    """Anchors (k,) and (k, 3) [m]: enough of them, apart, near the link and in its units."""
    where = check_points(points, "anchor_points")
    taxels = np.asarray(indices)
    if taxels.shape != (len(where),) or not np.issubdtype(taxels.dtype, np.integer):
        raise InvalidArrayError(
            f"anchor_indices must be {len(where)} whole numbers, one a point, "
            f"got {taxels.dtype} {taxels.shape}"
        )
    if len(where) < FEWEST:
        raise InvalidArrayError(f"a patch needs at least {FEWEST} anchors, got {len(where)}")
    wrong = np.flatnonzero((taxels < 0) | (taxels >= len(layout)))
    if len(wrong):
        raise InvalidArrayError(
            f"anchor {wrong[0]} is taxel {taxels[wrong[0]]}, the layout has 0..{len(layout) - 1}"
        )
    called = names[taxels]
    values, count = np.unique(called, return_counts=True)
    if (count > 1).any():
        name = values[count > 1][0]
        which = (np.flatnonzero(called == name) + 1).tolist()
        raise InvalidArrayError(
            f"channel {name} has {len(which)} anchors (the {_ordinals(which)}): one taxel is in "
            "one place; which channels are the others of?"
        )
    _, first, count = np.unique(where, axis=0, return_index=True, return_counts=True)
    if (count > 1).any():
        rows = (where == where[first[count > 1][0]]).all(axis=1)
        named = first_few(called[rows].tolist(), LISTED)
        raise InvalidArrayError(f"the anchors of channels {named} are at the same point")
    spread = np.asarray(sigma, np.float64)
    if spread.shape not in ((), (len(where),)):
        raise InvalidArrayError(
            f"anchor_sigma must be one number or {len(where)}, got {spread.shape}"
        )
    if not (np.isfinite(spread) & (spread > 0)).all():
        raise InvalidArrayError(f"anchor_sigma must be above 0 m, got {spread.min():g}")
    if in_a_row(layout[taxels], IN_A_ROW):
        raise InvalidArrayError(
            f"the {len(taxels)} anchors lie in a row on the board: the patch could turn about it "
            f"(channels {first_few(called.tolist(), LISTED)})"
        )
    check_spread(layout[taxels], where, "anchors")
    _check_near(link, where, called)
    return at_taxels(len(layout), taxels, where, np.broadcast_to(spread, len(where)))


def _ordinals(numbers: list[int]) -> str:
    """1st, 2nd, 3rd ..., in words for a message."""
    ends = {1: "st", 2: "nd", 3: "rd"}
    words = [f"{k}{'th' if 10 < k % 100 < 14 else ends.get(k % 10, 'th')}" for k in numbers]
    return f"{', '.join(words[:-1])} and {words[-1]}"


def in_a_row(points: FloatArray, share: float) -> bool:
    """Whether points (k, d) spread along one direction only, but for a share of it."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] < share * spread[0])


def check_spread(flat: FloatArray, body: FloatArray, kind: str) -> None:
    """Refuse places (k, 2) and points (k, 3) of other units, and say by which factor."""
    ratio = float(np.median(pdist(body)) / np.median(pdist(flat)))
    if RATIO[0] <= ratio <= RATIO[1]:
        return
    words = f"the {kind} lie {ratio:.3g} times as far apart as on the layout"
    mixed = mixed_units(ratio, RATIO, kind, "layout")
    if mixed:
        raise InvalidArrayError(f"{words}: {mixed}")
    raise InvalidArrayError(
        f"{words}, expected {RATIO[0]} to {RATIO[1]}: other taxels than named, or another unit"
    )


def mixed_units(ratio: float, fair: tuple[float, float], larger: str, smaller: str) -> str:
    """Which of two things of a ratio of lengths is in which unit, if that makes the ratio fair."""
    for unit, name in UNITS.items():
        for what, factor in ((larger, unit), (smaller, 1.0 / unit)):
            if fair[0] <= ratio * factor <= fair[1]:
                return f"is the {what} in {name}? Multiply its lengths by {unit:g}"
    return ""


def _check_near(link: Link, points: FloatArray, called: IntArray) -> None:
    distance, _, _ = closest_on_mesh(points, *link)
    far = distance > FAR
    if not far.any():
        return
    which = f"the anchors of channels {first_few(called[far].tolist(), LISTED)}"
    for unit, name in UNITS.items() if far.all() else ():
        for factor, what in ((unit, "the mesh"), (1.0 / unit, "all but the mesh")):
            scaled, _, _ = closest_on_mesh(points, link[0] * factor, link[1])
            if (scaled <= FAR).all():
                raise InvalidMeshError(
                    f"{which} lie up to {distance.max():.3g} m from the mesh: is {what} in {name}? "
                    f"Multiply the mesh's lengths by {factor:g}"
                )
    size = float(np.linalg.norm(np.ptp(link[0], axis=0)))
    raise InvalidMeshError(
        f"{which} lie up to {distance.max():.3g} m from the mesh, which is "
        f"{size:.3g} m long: another link or frame?"
    )
