"""Laws of where taxels are: units, normals, nearest places, registration, neighbours."""

from __future__ import annotations

import numpy as np

from skinmap.errors import InvalidArrayError
from skinmap.geometry.log_maps import log_map
from skinmap.geometry.proximity import closest_on_mesh, edge_graph, median_spacing
from skinmap.geometry.topology import edges
from skinmap.geometry.triangles import jacobians, singular_values
from skinmap.neighbours.offsets import neighbourhoods
from skinmap.skin.cover import fit_to_mesh
from skinmap.skin.modules import BUILTIN
from skinmap.skin.normals import repair_normals
from skinmap.skin.repair import detect_unit

from .law import Law, Outside
from .shapes import PITCH, dome, lattice, normals, with_holes

DOME, FACES = dome()


def spacing_off(offset: float) -> float:
    return float(abs(median_spacing(lattice() + offset) / median_spacing(lattice()) - 1))


def unit_missed(unit: str) -> float:
    """Whether positions in a unit are taken for another, with a layout and without."""
    scale = {"m": 1.0, "cm": 1e2, "mm": 1e3}[unit]
    pads = BUILTIN["triangle_12pad"]
    found = [
        detect_unit(scale * lattice() * pads.pitch / PITCH, pads),
        detect_unit(scale * lattice(), None),
    ]
    return float(sum(one != unit for one in found))


def normals_off(scale: float = 1.0, offset: float = 0.0, noise: float = 0.0,
                keep: np.ndarray | None = None) -> float:  # fmt: skip
    """Largest angle between estimated and true normals of a bent lattice [degrees]."""
    keep = np.ones(400, bool) if keep is None else keep
    points, true = lattice(20, 20)[keep], normals(20, 20)[keep]
    points = points + noise * PITCH * np.random.default_rng(0).normal(size=points.shape)
    found = repair_normals(scale * points + offset, None, true)
    along = np.clip(np.einsum("ni,ni->n", found, true), -1, 1)
    return float(np.degrees(np.arccos(along)).max())


def landed(scale: float = 1.0, offset: float = 0.0) -> float:
    """How far points a tenth above a dome land from where they came from, in widths."""
    normal = np.cross(DOME[FACES[:, 1]] - DOME[FACES[:, 0]], DOME[FACES[:, 2]] - DOME[FACES[:, 0]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    middle = DOME[FACES].mean(axis=1)
    points = scale * (middle + 1e-3 * normal) + offset
    _, _, closest = closest_on_mesh(points, scale * DOME + offset, FACES)
    return float(np.abs((closest - offset) / scale - middle).max())


def refitted(start: float) -> float:
    """Mean distance of a moved sheet from its mesh, once it is fitted [mm]."""
    points, faces = 0.1 * DOME, FACES
    middles = points[faces].mean(axis=1)
    moved = middles + 1e-3 * start * np.array([0.0, 0.0, 1.0])
    return float(1e3 * fit_to_mesh(moved, points, faces).after.mean())


def on_plane(scale: float) -> float:
    """Coordinates around a point of a plane against those of the plane, in widths."""
    flat = np.column_stack([DOME[:, :2], np.zeros(len(DOME))])
    up = np.tile([0.0, 0.0, 1.0], (len(flat), 1))
    graph = edge_graph(scale * flat, edges(FACES))
    frame = np.array([[1.0, 0, 0], [0, 1, 0]])
    found, _ = log_map(scale * flat, up, graph, 40, 10.0 * scale, frame=frame)
    return float(np.abs(found / scale - (flat - flat[40])[:, :2]).max())


def stretched(scale: float) -> float:
    """Singular values of a dome laid flat at another scale, against its own."""
    uv = DOME[:, :2]
    plain = np.stack(singular_values(jacobians(DOME, FACES, uv)))
    other = np.stack(singular_values(jacobians(scale * DOME, FACES, scale * uv)))
    return float(np.abs(other / plain - 1).max())


def around(scale: float = 1.0, offset: float = 0.0) -> float:
    """Neighbours that one of two skins has and the other has not."""
    north = np.tile([0.0, 1.0, 0.0], (144, 1))
    plain = neighbourhoods(lattice(), normals(), north, radius=9.7e-3, band=1e-3)
    moved = scale * lattice() + offset
    other = neighbourhoods(moved, normals(), north, radius=9.7e-3 * scale, band=1e-3 * scale)
    if plain.index.shape != other.index.shape:
        return float("inf")
    return float((np.sort(plain.index, axis=1) != np.sort(other.index, axis=1)).sum())


LAWS = [
    Law("median_spacing", "offset", "it stays, in shares", spacing_off, 1e-6,
        "1e4 m leave 1e-12 m of places, of pitches of 6.5e-3 m", (0.0, 1.0, 1e4), unit="m"),
    Law("detect_unit", "scale", "the unit is found, with a module layout and without",
        unit_missed, 0.0, "counted", ("m", "cm", "mm")),
    Law("repair_normals", "scale", "angle to true normals in degrees",
        lambda s: normals_off(scale=s), 12.4,
        "at the rim neighbours lie on one side, two taxels of 6.2 degrees away at most",
        (1e-3, 1.0, 1e3)),
    Law("repair_normals", "offset", "angle to true normals in degrees",
        lambda s: normals_off(offset=s), 12.4, "the rim, as above", (0.0, 1.0, 1e3), unit="m"),
    Law("repair_normals", "noise", "angle to true normals in degrees",
        lambda s: normals_off(noise=s), 18.1,
        "the rim, and a tenth of a pitch in one: 5.7 degrees", (0.0, 0.05, 0.1),
        unit="of the pitch"),
    Law("repair_normals", "missing modules", "angle to true normals in degrees",
        lambda n: normals_off(keep=with_holes(n)), 12.4, "rims of holes are rims", (0, 1, 6),
        (Outside("a row of taxels without normals", InvalidArrayError,
                 lambda: repair_normals(np.outer(np.arange(9.0), [1.0, 0, 0]), None)),),
        "of nine taxels"),
    Law("closest_on_mesh", "scale", "in widths from where the points came from", landed, 1e-9,
        "rounding", (1e-6, 1e-3, 1.0, 1e3, 1e6)),
    Law("closest_on_mesh", "offset", "in widths from where the points came from",
        lambda s: landed(offset=s), 1e-6, "1e6 leaves ten digits, and squares half of them",
        (0.0, 1.0, 1e3), unit="times the width"),
    Law("fit_to_mesh", "start", "mean distance from the mesh in mm", refitted, 0.1,
        "steps end once the mean no longer falls", (0.0, 1.0, 10.0), unit="mm off"),
    Law("log_map", "scale", "on a plane those of the plane, in widths", on_plane, 1e-9, "rounding",
        (1e-6, 1.0, 1e6)),
    Law("singular_values", "scale", "they stay, in shares", stretched, 1e-9, "rounding",
        (1e-30, 1e-6, 1.0, 1e6, 1e30)),
    Law("neighbourhoods", "scale", "the same neighbours", around, 0.0, "counted",
        (1e-6, 1e-3, 1.0, 1e3, 1e6)),
    Law("neighbourhoods", "offset", "the same neighbours", lambda s: around(offset=s), 0.0,
        "counted", (0.0, 1.0, 1e4), unit="m"),
]  # fmt: skip
