"""One surface with a border laid flat: checks before, the method, checks after, a fallback."""

from __future__ import annotations

import logging
import warnings
from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, IntArray, check_faces, check_points
from skinmap.errors import FlatteningError, InvalidMeshError, SkinWarning
from skinmap.flat.budget import Choice, within_budget
from skinmap.flat.disc import Disc
from skinmap.flat.methods import OWN, apply_flattener, check_effort
from skinmap.geometry.topology import check_surface, loop_length, loops_by_length
from skinmap.geometry.triangles import vertex_normals
from skinmap.surface.consensus_meshing import close_loop, used_chords

logger = logging.getLogger(__name__)

DEFAULT = "balanced"
HOLE_SHARE = 0.35  # a hole's length against the border's: up to here it is filled for the solve
FALLBACKS = ("bff", "dirichlet", "bijective", "tutte")  # the last never flips but for rounding
ONE_TO_ONE = ("bijective", "tutte")  # what may mend a map that overlaps itself
NO_AREA = 1e-12  # smallest altitude against the size of the surface that numbers still resolve


@dataclass(frozen=True, eq=False, slots=True)
class DiscMap:
    """A flat map that passed our checks.

    Attributes
    ----------
    uv : (n, 2) float
        Finite and free of flips [m].
    method : str
        The method that made it.
    fallback : bool
        Whether the method asked for failed and this is another.
    holes : int
        Boundary loops beside the outer one.
    reason : str
        Why this method, where `auto` chose it; otherwise empty.
    """

    uv: FloatArray
    method: str
    fallback: bool
    holes: int
    reason: str = ""


def flatten_disc(
    vertices: FloatArray, faces: IntArray, *, method: str = DEFAULT, where: str = "mesh"
) -> tuple[FloatArray, str, int]:
    """Flat coordinates, method and number of holes of `map_disc`, without a budget."""
    flat = map_disc(vertices, faces, method=method, where=where)
    return flat.uv, flat.method, flat.holes


def map_disc(
    vertices: FloatArray,
    faces: IntArray,
    *,
    method: str = DEFAULT,
    where: str = "mesh",
    max_seconds: float | None = None,
    max_edge_rms: float | None = None,
    iterations: int | None = None,
    may_overlap: bool = False,
) -> DiscMap:
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
    max_seconds : float, optional
        For `auto`: CPU time to keep to [s].
    max_edge_rms : float, optional
        For `auto`: edge error to reach, 0.01 for 1 %.
    iterations : int, optional
        Of a method that has them, instead of its own number.
    may_overlap : bool
        Leave a map that lies over itself as it is: for trials, mending takes long.

    Raises
    ------
    InvalidArrayError, InvalidMeshError
        Iterations that the method cannot have; values that are not finite,
        vertices that no face uses, faces that are no surface.
    FlatteningError
        No border, a hole too wide to fill (a tube), a triangle without area, or one that no
        method keeps from flipping.
    """
    check_effort(method, iterations)
    disc, size, holes = _prepare(vertices, faces, where)
    if method == "auto":
        choice = _choose(disc, max_seconds, max_edge_rms)
        if choice is not None:
            if not choice.met:
                words = f"{where}: no method keeps to the budget; {choice.method} comes nearest"
                warnings.warn(f"{words} ({choice.reason})", SkinWarning, stacklevel=3)
            return DiscMap(choice.uv * size, choice.method, False, holes, choice.reason)
    overlapped = False
    for name in (method, *FALLBACKS):
        if overlapped and name not in ONE_TO_ONE:
            continue
        uv = _attempt(name, disc, iterations if name == method else None)
        if uv is not None and (may_overlap or not disc.overlaps(uv)):
            break
        overlapped |= uv is not None
    else:
        raise FlatteningError(f"{where}: neither {method} nor a convex map is free of flips")
    if name != method:
        what = "overlaps itself" if overlapped else "flips or fails"
        warnings.warn(f"{where}: {method} {what}, {name} is used", SkinWarning, stacklevel=3)
    return DiscMap(uv * size, name, name != method, holes)


def _choose(disc: Disc, max_seconds: float | None, max_edge_rms: float | None) -> Choice | None:
    """What `auto` takes; None where it fails or flips."""
    try:
        choice = within_budget(disc, max_seconds=max_seconds, max_edge_rms=max_edge_rms)
    except (ArithmeticError, ValueError, RuntimeError):  # a singular matrix, whatever it is called
        logger.info("flattening method auto fails", exc_info=True)
        return None
    return choice if disc.is_injective(choice.uv) and not disc.overlaps(choice.uv) else None


def _attempt(name: str, disc: Disc, iterations: int | None) -> FloatArray | None:
    """Coordinates (n, 2) by one method; None where it fails, flips or is not finite."""
    try:
        uv = apply_flattener(name, disc, iterations=iterations)
    except Exception as error:  # what a library or a plug-in stumbles over, another may not
        if isinstance(error, TypeError) and name in OWN:  # a fault of the call, not of the surface
            raise
        logger.info("flattening method %s fails", name, exc_info=True)
        return None
    return uv if disc.is_injective(uv) else None


def _prepare(vertices: FloatArray, faces: IntArray, where: str) -> tuple[Disc, float, int]:
    """The surface at unit size round its centre, holes filled; its size [m] and holes."""
    _check_input(vertices, faces, where)
    loops = loops_by_length(vertices, faces)
    if not loops:
        raise FlatteningError(f"{where} is closed: cut it open first")
    filled, normals = [faces], vertex_normals(vertices, faces)
    for loop in loops[1:]:
        if loop_length(vertices, loop) > HOLE_SHARE * loop_length(vertices, loops[0]):
            raise FlatteningError(f"{where} is a tube or has a wide hole: cut it open first")
        used = used_chords(np.concatenate(filled), loop)
        closed = close_loop(vertices, normals, loop, used=used)
        filled.append(closed if len(closed) else close_loop(vertices, normals, loop))
    centre, size = vertices.mean(axis=0), float(np.ptp(vertices, axis=0).max())
    disc = Disc((vertices - centre) / (size or 1.0), np.concatenate(filled), loops[0])
    if disc.smallest_altitudes[: len(faces)].min() <= NO_AREA:
        raise FlatteningError(f"{where} has a triangle without area")
    # Every vertex is used and every edge lies in two faces but for those of the outer loop.
    edges = (3 * len(disc.faces) + len(loops[0])) // 2
    if (number := len(vertices) - edges + len(disc.faces)) != 1:
        raise FlatteningError(f"{where} is not a disc: Euler number {number}")
    return disc, size, len(loops) - 1


def _check_input(vertices: FloatArray, faces: IntArray, where: str) -> None:
    if len(faces) == 0:
        raise FlatteningError(f"{where} has no faces")
    check_points(vertices, f"vertices of {where}")
    check_faces(faces, len(vertices))
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    if not used.all():
        raise InvalidMeshError(
            f"vertex {int(np.argmin(used))} belongs to no face of {where}: drop it first"
        )
    check_surface(faces)
